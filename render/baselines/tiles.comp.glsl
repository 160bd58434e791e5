// Splats, sorted by tile and depth -> picture. One group a tile of 8x8 px, one lane a column:
// eight lanes are one vector register of a software driver.
#version 430
layout(local_size_x = 8) in;

layout(std430, binding = 0) readonly buffer Splats { uvec4 splats[]; };
layout(std430, binding = 1) readonly buffer Pairs { uint pairs[]; };    // splats, tile after tile
layout(std430, binding = 2) readonly buffer Starts { uint starts[]; };  // tile -> first pair
layout(std430, binding = 3) writeonly buffer Pixels { uint pixels[]; }; // RGBA8, top row first

uniform uvec2 size;        // px
uniform vec3 background;

const float CUTOFF = -6.0;  // log2 of the faintest alpha that is drawn, 1/64
const float MAX_ALPHA = 0.999;
const float OPAQUE = 1.0 / 100.0;  // a column this opaque hides the rest

void main() {
    uint tile = gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x;
    uvec2 corner = gl_WorkGroupID.xy * 8u;
    float x = float(corner.x + gl_LocalInvocationID.x) + 0.5;
    float y = float(corner.y) + 0.5;
    uint end = starts[tile + 1u];
    vec4 acc[8];  // colour in 0..65535, transmittance
    for (int row = 0; row < 8; row++) acc[row] = vec4(0.0, 0.0, 0.0, 1.0);

    for (uint i = starts[tile]; i < end; i++) {
        uint id = 2u * pairs[i];
        vec4 a = uintBitsToFloat(splats[id]);
        uvec4 b = splats[id + 1u];
        float r = uintBitsToFloat(b.x), log2_opacity = uintBitsToFloat(b.y);
        vec3 color = vec3(float(b.z & 0xffffu), float(b.z >> 16), float(b.w & 0xffffu));
        float dy = y - a.y;
        float u = a.z * (x - a.x) + a.w * dy;
        float v = r * dy;
        for (int row = 0; row < 8; row++) {
            float power = log2_opacity - u * u - v * v;
            float alpha = power < CUTOFF ? 0.0 : min(exp2(power), MAX_ALPHA);
            float weight = alpha * acc[row].w;
            acc[row].rgb += weight * color;
            acc[row].w -= weight;
            u += a.w;
            v += r;
        }
        float left = 0.0;
        for (int row = 0; row < 8; row++) left = max(left, acc[row].w);
        if (left < OPAQUE) break;
    }
    for (uint row = 0u; row < 8u; row++) {
        uvec2 pixel = corner + uvec2(gl_LocalInvocationID.x, row);
        if (pixel.x < size.x && pixel.y < size.y) {
            vec3 rgb = acc[row].rgb / 65535.0 + acc[row].w * background;
            pixels[pixel.y * size.x + pixel.x] = packUnorm4x8(vec4(rgb, 1.0 - acc[row].w));
        }
    }
}
