// One splat an instance: the parallelogram |u| <= R, |v| <= R around the ellipse u^2 + v^2 <= R^2.
#version 430
layout(std430, binding = 0) readonly buffer Splats { uvec4 splats[]; };  // from project.comp.glsl
layout(std430, binding = 1) readonly buffer Order { uint order[]; };     // farthest first

uniform vec2 size;  // px

const float FAINTEST = 6.0;  // -log2 of the faintest alpha that is drawn

out vec2 uv;
flat out vec4 color;  // rgb, log2 of the opacity

void main() {
    uint id = 2u * order[gl_InstanceID];
    vec4 a = uintBitsToFloat(splats[id]);
    uvec4 b = splats[id + 1u];
    float r = uintBitsToFloat(b.x), log2_opacity = uintBitsToFloat(b.y);
    float radius = sqrt(max(log2_opacity + FAINTEST, 0.0));
    uv = radius * vec2((gl_VertexID & 1) * 2 - 1, (gl_VertexID >> 1) * 2 - 1);
    float dy = uv.y / r;
    float dx = (uv.x - a.w * dy) / a.z;
    color = vec4(unpackUnorm2x16(b.z), unpackUnorm2x16(b.w).x, log2_opacity);
    // y is not flipped: row 0 of the framebuffer is the top of the picture.
    gl_Position = vec4((a.xy + vec2(dx, dy)) / size * 2.0 - 1.0, 0.0, 1.0);
}
