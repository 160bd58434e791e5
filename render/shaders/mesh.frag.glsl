// Shading of render/lighting.py, per pixel, and what it mirrors, of skin with its fine relief.
#version 330
in vec3 v_position;
in vec3 v_normal;
in vec2 v_uv;
in vec3 v_color;
in vec4 v_seen;
flat in int v_kind;
uniform sampler2D skin;
uniform sampler2D eye;
uniform sampler2D relief;  // of the face's half of the atlas: height mm, oil, roughness
uniform sampler2D wrinkles;  // see render/wrinkles.py
uniform vec4 folds[2];       // how much of each kind on the left side, on the right one
uniform float across;        // mm
uniform vec3 fold_tint;
uniform vec3 viewer;       // mm
uniform vec3 towards[4], lamps[4];  // key, fill, rims left and right
uniform float half_widths[4];
uniform vec3 sky, ground, wrap, bleed, bounce;
uniform float film[5];
uniform float sheen;  // see lighting.SHEEN
uniform bool mirrors;  // else matte
const int STATIONS = 24;
uniform vec3 lids[2 * STATIONS];  // left eye first: x, heights of the upper and the lower edge, mm
uniform vec3 lid_shade[2];        // see render/decoder/lines.py
uniform vec2 lid_reach;
uniform bool lidded;              // else nothing shades the eyes
out vec4 fragment;

const vec2 PLAIN = vec2(0.40, 0.50);  // oil and roughness off the face
const vec2 WET = vec2(1.1, 0.28), TOOTH = vec2(1.3, 0.20);
const float STEEPEST = 0.55, SKIN_F0 = 0.028, SPREAD = 0.5;
const float BOX_EDGE = 0.05, BOX_LIGHT = 40.0;  // in an eye
const vec2 BOX = vec2(0.14, 0.18);

vec3 bled(float share) { return share * (1.0 + bleed * (1.0 - share)); }

// The normal under a height map, from differences between neighbouring pixels (Mikkelsen 2010).
vec3 bumped(vec3 n, float height) {
    vec3 across = dFdx(v_position), down = dFdy(v_position);
    vec3 r1 = cross(down, n), r2 = cross(n, across);
    float det = dot(across, r1);
    vec3 slope = sign(det) * (dFdx(height) * r1 + dFdy(height) * r2) / max(abs(det), 1e-6);
    float steep = length(slope);
    return normalize(n - slope * min(1.0, STEEPEST / max(steep, 1e-6)));
}

// Karis' fit of GGX with visibility and Fresnel, for a lamp as wide as `spread`; times pi.
float mirrored(vec3 n, vec3 v, vec3 l, float rough, float f0) {
    vec3 h = normalize(l + v);
    float nh = max(dot(n, h), 0.0), lh = max(dot(l, h), 0.0), nl = max(dot(n, l), 0.0);
    float a2 = rough * rough * rough * rough, d = nh * nh * (a2 - 1.0) + 1.0;
    float fresnel = f0 + (1.0 - f0) * pow(1.0 - lh, 5.0);
    return a2 / (d * d) * fresnel * nl / (4.0 * max(lh * lh, 0.1) * (rough + 0.5));
}

// What an eye's wet surface mirrors: the key light as a box.
vec3 box(vec3 n, vec3 v) {
    vec3 r = reflect(-v, n), side = normalize(cross(towards[0], vec3(0.0, 1.0, 0.0)));
    float front = dot(r, towards[0]);
    vec2 at = abs(vec2(dot(r, side), dot(r, cross(side, towards[0])))) / max(front, 0.01);
    vec2 inside = step(0.0, front) * clamp((BOX - at) / BOX_EDGE, 0.0, 1.0);
    float fresnel = 0.022 + 0.978 * pow(1.0 - max(dot(n, v), 0.0), 5.0);
    return inside.x * inside.y * v_seen.y * lamps[0] * fresnel * BOX_LIGHT;
}

vec3 film_of(vec3 linear) {
    vec3 x = max(linear, 0.0);
    x = x * (film[0] * x + film[1]) / (x * (film[2] * x + film[3]) + film[4]);
    return sqrt(clamp(x, 0.0, 1.0));
}

// What a lid and its lashes keep from the eye below: by the height under the lid's edge, of a stored
// colour, as `Line.tint_covered` has it.
vec3 lid_shadow() {
    for (int first = 0; first < 2 * STATIONS; first += STATIONS) {
        float left = lids[first].x, step = (lids[first + STATIONS - 1].x - left) / (STATIONS - 1);
        float at = (v_position.x - left) / max(step, 1e-6);
        if (at < 0.0 || at >= STATIONS) continue;
        int k = min(int(at), STATIONS - 2);
        vec3 edges = mix(lids[first + k], lids[first + k + 1], at - k);
        vec2 off = vec2(edges.y - v_position.y, v_position.y - edges.z);
        vec2 near = max(off, 0.0) / lid_reach;
        near = 1.0 / (1.0 + near * near);
        near *= near;
        return (1.0 - lid_shade[0] * near.x) * (1.0 - lid_shade[1] * near.y);
    }
    return vec3(1.0);
}

void main() {
    vec3 n = normalize(v_normal), v = normalize(viewer - v_position);
    vec3 albedo = v_color;
    vec2 surface = v_kind == 3 ? TOOTH : v_kind == 2 ? WET : PLAIN;
    vec3 micro = n;
    if (v_kind == 0) {
        albedo *= texture(skin, v_uv * vec2(0.5, 1.0)).rgb;
        vec4 map = texture(relief, v_uv);
        vec3 under = bumped(n, map.x);
        if (v_uv.x < 1.0) {
            surface = map.yz, micro = under;
            vec4 most = mix(folds[1], folds[0], smoothstep(-across, across, v_position.x));
            albedo *= max(1.0 - fold_tint * dot(texture(wrinkles, v_uv), most), 0.0);
        }
    }
    if (v_kind == 1) albedo *= texture(eye, v_uv).rgb;
    float shares[4] = float[4](v_seen.y, v_seen.x, v_seen.z, v_seen.w);
    vec3 light = mix(ground, sky, 0.5 * n.y + 0.5) * (bounce + (1.0 - bounce) * bled(v_seen.x));
    for (int k = 0; k < 4; k++) {
        vec3 lit = max((vec3(dot(n, towards[k])) + wrap) / (1.0 + wrap), 0.0) * lamps[k];
        light += lit * (k == 1 ? bounce + (1.0 - bounce) * bled(shares[k]) : bled(shares[k]));
    }
    vec3 linear = albedo * albedo * light;
    if (mirrors && v_kind != 1) {
        float f0 = v_kind == 3 ? 0.045 : SKIN_F0;
        for (int k = 0; k < 4; k++) {
            float soft = SPREAD * half_widths[k];
            float wide = mirrored(micro, v, towards[k], min(surface.y + soft, 1.0), f0);
            float tight = mirrored(micro, v, towards[k], 0.55 * surface.y + soft, f0);
            float share = k < 2 ? shares[k] : sheen * shares[k];
            linear += (0.7 * wide + 0.3 * tight) * surface.x * share * lamps[k];
        }
    }
    vec3 stored = film_of(linear);
    if (v_kind == 1) {
        vec3 shade = lidded ? lid_shadow() : vec3(1.0);
        vec3 mirror = mirrors ? film_of(linear + box(n, v)) - stored : vec3(0.0);
        stored = stored * shade + mirror;
    }
    fragment = vec4(stored, 1.0);
}
