// Shading of render/lighting.py, per pixel.
#version 430
in vec3 v_normal;
in vec2 v_uv;
in vec3 v_color;
in vec2 v_light_seen;
flat in int v_kind;
uniform sampler2D skin;
uniform sampler2D eye;
uniform sampler2D lashes;
uniform vec3 light_key, light_fill, light_rim, light_sky, light_ground;
uniform float bounce;
uniform vec3 to_key, to_fill, to_rim, to_half, wrap;
out vec4 fragment;

vec3 wrapped(float cosine) { return max((vec3(cosine) + wrap) / (1.0 + wrap), 0.0); }

void main() {
    vec3 n = normalize(v_normal);
    if (v_kind == 4) {
        fragment = vec4(v_color, 0.9 * texture(lashes, v_uv).r);
        return;
    }
    vec3 albedo = v_color;
    if (v_kind == 0) albedo *= texture(skin, v_uv * vec2(0.5, 1.0)).rgb;
    if (v_kind == 1) albedo *= texture(eye, v_uv).rgb;
    vec3 light = mix(light_ground, light_sky, 0.5 * n.y + 0.5);
    light += wrapped(dot(n, to_fill)) * light_fill + wrapped(dot(n, to_rim)) * light_rim;
    light = light * (bounce + (1.0 - bounce) * v_light_seen.x) + wrapped(dot(n, to_key)) * light_key * v_light_seen.y;
    float facing = pow(max(dot(n, to_half), 0.0), 16.0);
    float shine = v_kind == 0 ? 0.045 * facing : 0.10 * pow(facing, 4.0);
    if (v_kind == 1) shine = 0.02 * facing + 0.95 * pow(facing, 16.0);  // the cornea's highlight
    vec3 linear = albedo * albedo * light + shine * v_light_seen.y;
    fragment = vec4(sqrt(clamp(linear, 0.0, 1.0)), 1.0);
}
