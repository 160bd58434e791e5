// One splat an instance: the parallelogram |u| <= R, |v| <= R around the ellipse u^2 + v^2 <= R^2.
#version 430
layout(std430, binding = 0) readonly buffer Splats { uvec4 splats[]; };  // farthest first

uniform vec2 size;  // px

const float FAINTEST = 6.0;  // -log2 of the faintest alpha that is drawn

out vec2 uv;
flat out vec4 color;  // rgb, log2 of the opacity

vec3 unpack_axes(uvec2 word) {  // as in tiles.comp.glsl
    return vec3(
        uintBitsToFloat(((word.x & 0xffffu) << 12) + (97u << 23)),
        uintBitsToFloat((word.x >> 16 << 12 & 0x7ffffffu) + (114u << 23) | word.x & 0x80000000u),
        uintBitsToFloat(((word.y & 0xffffu) << 12) + (97u << 23)));
}

void main() {
    uvec4 splat = splats[gl_InstanceID];
    vec3 pqr = unpack_axes(splat.xy);
    float log2_opacity = float(splat.y >> 16 & 1023u) * (-FAINTEST / 1023.0);
    vec2 mean = vec2(splat.zw >> 12) * (1.0 / 128.0) - 2048.0;
    vec3 rgb = vec3(
        splat.z >> 2 & 1023u, splat.w >> 2 & 1023u,
        splat.y >> 26 << 4 | (splat.z & 3u) << 2 | (splat.w & 3u));
    float radius = sqrt(log2_opacity + FAINTEST);
    uv = radius * vec2((gl_VertexID & 1) * 2 - 1, (gl_VertexID >> 1) * 2 - 1);
    float dy = uv.y / pqr.z;
    float dx = (uv.x - pqr.y * dy) / pqr.x;
    color = vec4(rgb / 1023.0, log2_opacity);
    // y is not flipped: row 0 of the framebuffer is the top of the picture.
    gl_Position = vec4((mean + vec2(dx, dy)) / size * 2.0 - 1.0, 0.0, 1.0);
}
