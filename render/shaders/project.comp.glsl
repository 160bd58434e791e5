// Gaussians -> splats (EWA projection); one lane a Gaussian. The oracle is render/reference.py.
layout(local_size_x = 64) in;

layout(std430, binding = 0) readonly buffer Means { float means[]; };
layout(std430, binding = 1) readonly buffer Quats { float quats[]; };
layout(std430, binding = 2) readonly buffer Scales { float scales[]; };
layout(std430, binding = 3) readonly buffer Opacities { float opacities[]; };
layout(std430, binding = 4) readonly buffer Colors { float colors[]; };
layout(std430, binding = 5) writeonly buffer Splats { uvec4 splats[]; };  // packed
layout(std430, binding = 6) writeonly buffer Depths { float depths[]; };  // mm, HIDDEN or BROKEN
layout(std430, binding = 7) writeonly buffer Boxes { uvec4 boxes[]; };    // tiles, see main

uniform int num_gaussians;
uniform mat4 view;     // world to camera
uniform vec4 lens;     // focal x, y; centre x, y (px)
uniform vec2 size;     // px
uniform vec2 tile;     // px
uniform float near_mm;

const float HIDDEN = 3.0e38;  // depth of a splat outside the picture
const float BROKEN = 3.2e38;  // and of one that no picture can show
const float LOW_PASS = 0.3;
const float MAX_ALPHA = 0.999;
const float HALF_LOG2_E = 0.72134752;

const float SLACK = 0.02;  // px
const vec2 MOST = vec2(15.0, 8.0);  // tiles across and down of a box with rows

// The tiles that an ellipse reaches in a row of tiles, whose middle is dy from its centre.
vec2 reach(Splat s, float half_height, float dy) {
    vec2 ends = dy + vec2(-0.5, 0.5) * (tile.y - 1.0) + vec2(-SLACK, SLACK);
    float widest = s.q * half_height * inversesqrt(s.q * s.q + s.r * s.r);  // where it is leftmost
    vec2 at = clamp(vec2(widest, -widest), max(ends.x, -half_height), min(ends.y, half_height));
    vec2 v = s.r * at;
    vec2 arm = sqrt(max(s.log2_opacity + FAINTEST - v * v, 0.0)) * vec2(-1.0, 1.0) - s.q * at;
    vec2 x = s.xy.x + arm / s.p + vec2(-SLACK, SLACK);
    vec2 pixels = vec2(ceil(x.x - 0.5), floor(x.y + 0.5));
    bool hit = ends.x <= half_height && ends.y >= -half_height && pixels.x < pixels.y;
    return hit ? vec2(floor(pixels.x / tile.x), ceil(pixels.y / tile.x)) : vec2(0.0);
}

mat3 rotation(vec4 wxyz) {
    vec4 q = wxyz / length(wxyz);
    float w = q.x, x = q.y, y = q.z, z = q.w;
    return mat3(
        1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y),
        2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x),
        2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y));
}

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= uint(num_gaussians)) return;
    vec3 mean = vec3(means[3u * i], means[3u * i + 1u], means[3u * i + 2u]);
    vec4 quat = vec4(quats[4u * i], quats[4u * i + 1u], quats[4u * i + 2u], quats[4u * i + 3u]);
    vec3 scale = vec3(scales[3u * i], scales[3u * i + 1u], scales[3u * i + 2u]);
    vec3 color = vec3(colors[3u * i], colors[3u * i + 1u], colors[3u * i + 2u]);
    float opacity = opacities[i];

    // False for NaN: comparisons with it fail.
    bool sound = length(mean) < 1.0e18 && length(quat) > 1.0e-18 && length(quat) < 1.0e18
        && all(greaterThanEqual(scale, vec3(0.0))) && length(scale) > 0.0 && length(scale) < 1.0e9
        && opacity >= exp2(-FAINTEST) && opacity < 1.0e18 && length(color) < 1.0e18;

    vec3 point = (view * vec4(mean, 1.0)).xyz;
    bool visible = sound && point.z >= near_mm;
    float inverse_z = 1.0 / (visible ? point.z : 1.0);
    vec2 slope = point.xy * inverse_z;
    vec2 xy = slope * lens.xy + lens.zw;
    vec2 margin = 0.15 * size / lens.xy;
    slope = clamp(slope, -lens.zw / lens.xy - margin, (size - lens.zw) / lens.xy + margin);

    // Rows of the Jacobian times the axes of the Gaussian: the covariance is their product.
    mat3 axes = mat3(view) * rotation(quat);
    axes = mat3(axes[0] * scale.x, axes[1] * scale.y, axes[2] * scale.z);
    vec3 row_x = lens.x * inverse_z * vec3(1.0, 0.0, -slope.x) * axes;
    vec3 row_y = lens.y * inverse_z * vec3(0.0, 1.0, -slope.y) * axes;
    float xx = dot(row_x, row_x) + LOW_PASS;
    float yy = dot(row_y, row_y) + LOW_PASS;
    float k = dot(row_x, row_y) / yy;
    Splat splat;
    splat.xy = xy;
    splat.p = sqrt(HALF_LOG2_E / max(xx - k * k * yy, 1.0e-6));
    splat.q = -splat.p * k;
    splat.r = sqrt(HALF_LOG2_E / yy);
    splat.log2_opacity = log2(clamp(opacity, 1.0e-6, MAX_ALPHA));
    splat.color = 1023.0 * color;
    splats[i] = pack(splat);

    vec2 half_size = sqrt((splat.log2_opacity + FAINTEST) / HALF_LOG2_E * vec2(xx, yy));
    vec2 low = clamp(floor((xy - half_size) / tile), vec2(0.0), ceil(size / tile));
    vec2 high = clamp(ceil((xy + half_size) / tile), vec2(0.0), ceil(size / tile));
    visible = visible && all(greaterThan(high, low));  // false for NaN

    depths[i] = visible ? point.z : sound ? HIDDEN : BROKEN;

    // Two corners, and for each row of the box a byte: tiles left out << 4 | tiles reached.
    uvec2 rows = uvec2(0xffffffffu);
    if (all(lessThanEqual(high - low, MOST))) {
        rows = uvec2(0u);
        float half_height = half_size.y;
        for (int row = 0; row < int(high.y - low.y); row++) {
            float y = low.y + float(row);
            vec2 columns = clamp(reach(splat, half_height, (y + 0.5) * tile.y - xy.y), low.x, high.x);
            uint reached = uint(max(columns.y - columns.x, 0.0));
            uint bits = reached > 0u ? uint(columns.x - low.x) << 4 | reached : 0u;
            rows[row >> 2] |= bits << (8 * (row & 3));
        }
    }
    boxes[i] = uvec4(
        uint(low.x) | uint(low.y) << 16, uint(high.x) | uint(high.y) << 16, rows);
}
