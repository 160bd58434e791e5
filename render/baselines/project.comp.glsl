// Gaussians -> splats (EWA projection); one lane a Gaussian. The oracle is render/reference.py.
#version 430
layout(local_size_x = 64) in;

layout(std430, binding = 0) readonly buffer Means { float means[]; };
layout(std430, binding = 1) readonly buffer Quats { float quats[]; };
layout(std430, binding = 2) readonly buffer Scales { float scales[]; };
layout(std430, binding = 3) readonly buffer Opacities { float opacities[]; };
layout(std430, binding = 4) readonly buffer Colors { float colors[]; };
layout(std430, binding = 5) writeonly buffer Splats { uvec4 splats[]; };  // two for each Gaussian
layout(std430, binding = 6) writeonly buffer Depths { float depths[]; };  // mm; HIDDEN if invisible
layout(std430, binding = 7) writeonly buffer Rects { uvec2 rects[]; };    // tiles: x0|y0, x1|y1

uniform int num_gaussians;
uniform mat4 view;     // world to camera
uniform vec4 lens;     // focal x, y; centre x, y (px)
uniform vec2 size;     // px
uniform vec2 tile;     // px
uniform float near_mm;

const float HIDDEN = 3.0e38;
const float LOW_PASS = 0.3;
const float FAINTEST = 6.0;  // -log2 of the faintest alpha that is drawn
const float HALF_LOG2_E = 0.72134752;

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

    vec3 point = (view * vec4(mean, 1.0)).xyz;
    bool visible = point.z >= near_mm && opacity >= exp2(-FAINTEST);
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
    // alpha = exp2(log2_opacity - u^2 - v^2), u = p dx + q dy, v = r dy: the Cholesky factor of the
    // inverse covariance keeps long thin splats exact where the inverse itself would cancel.
    float p = sqrt(HALF_LOG2_E / max(xx - k * k * yy, 1.0e-6));
    float q = -p * k;
    float r = sqrt(HALF_LOG2_E / yy);
    float log2_opacity = log2(max(opacity, 1.0e-6));

    vec2 half_size = sqrt((log2_opacity + FAINTEST) / HALF_LOG2_E * vec2(xx, yy));
    vec2 low = clamp(floor((xy - half_size) / tile), vec2(0.0), ceil(size / tile));
    vec2 high = clamp(ceil((xy + half_size) / tile), vec2(0.0), ceil(size / tile));
    visible = visible && all(greaterThan(high, low));  // false for NaN

    depths[i] = visible ? point.z : HIDDEN;
    rects[i] = uvec2(uint(low.x) | uint(low.y) << 16, uint(high.x) | uint(high.y) << 16);
    splats[2u * i] = floatBitsToUint(vec4(xy, p, q));
    splats[2u * i + 1u] = uvec4(
        floatBitsToUint(vec2(r, log2_opacity)),
        packUnorm2x16(color.rg), packUnorm2x16(vec2(color.b, 0.0)));
}
