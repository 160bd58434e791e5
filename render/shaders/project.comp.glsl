// Gaussians -> splats (EWA projection); one lane a Gaussian. On a CPU render/projection_kernels.py does
// the same; the oracle of both is render/reference.py.
layout(local_size_x = 64) in;

layout(std430, binding = 0) readonly buffer Means { float means[]; };
layout(std430, binding = 1) readonly buffer Quats { float quats[]; };
layout(std430, binding = 2) readonly buffer Scales { float scales[]; };
layout(std430, binding = 3) readonly buffer Opacities { float opacities[]; };
layout(std430, binding = 4) readonly buffer Colors { float colors[]; };
layout(std430, binding = 5) writeonly buffer Splats { uvec4 splats[]; };  // packed
layout(std430, binding = 6) writeonly buffer Depths { float depths[]; };  // mm, HIDDEN or BROKEN

uniform int num_gaussians;
uniform mat4 view;     // world to camera
uniform vec4 lens;     // focal x, y; centre x, y (px)
uniform vec2 size;     // px
uniform float near_mm;

const float HIDDEN = 3.0e38;  // depth of a splat outside the picture
const float BROKEN = 3.2e38;  // and of one that no picture can show
const float LOW_PASS = 0.3;
const float MAX_ALPHA = 0.999;
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
    // false for NaN
    visible = visible && all(lessThan(xy - half_size, size)) && all(greaterThan(xy + half_size, vec2(0.0)));
    depths[i] = visible ? point.z : sound ? HIDDEN : BROKEN;
}
