// Splats, sorted by tile and depth -> picture. One group a tile of 8x8 px, one lane a column:
// eight lanes are one vector register of a software driver, which loads lane by lane, so that
// loads cost more than arithmetic: splats are 16 bytes and come four at a time.
#version 430
layout(local_size_x = 8) in;

layout(std430, binding = 0) readonly buffer Splats { uvec4 splats[]; };  // nearest first
layout(std430, binding = 1) readonly buffer Pairs { uvec4 pairs[]; };    // tile after tile
layout(std430, binding = 2) readonly buffer Starts { uint starts[]; };   // tile -> first pair
layout(std430, binding = 3) writeonly buffer Pixels { uint pixels[]; };  // RGBA8, top row first

uniform uvec2 size;        // px
uniform vec3 background;
uniform uint rank_mask;    // the bits of a pair that are the index of its splat

const float FAINTEST = 6.0;
const float CUTOFF = 1.0 / 64.0;  // the faintest alpha that is drawn
const float OPAQUE = 1.0 / 128.0;  // a column this opaque hides the rest

// p, r: 5 bits of exponent from 2^-30, 11 of mantissa; q: sign, 4 from 2^-13, 11. No half floats:
// software drivers take a dozen instructions to widen one.
vec3 unpack_axes(uvec2 word) {
    return vec3(
        uintBitsToFloat(((word.x & 0xffffu) << 12) + (97u << 23)),
        uintBitsToFloat((word.x >> 16 << 12 & 0x7ffffffu) + (114u << 23) | word.x & 0x80000000u),
        uintBitsToFloat(((word.y & 0xffffu) << 12) + (97u << 23)));
}

vec2 top;     // centre of the lane's first pixel
vec4 acc[8];  // colour in 0..1023, transmittance

void add(int row, float alpha, vec3 color) {
    float weight = alpha < CUTOFF ? 0.0 : alpha * acc[row].w;
    acc[row].rgb += weight * color;
    acc[row].w -= weight;
}

void blend(uint pair, bool inside) {
    uvec4 splat = splats[pair & rank_mask];
    vec3 pqr = unpack_axes(splat.xy);
    float p = pqr.x, q = pqr.y, r = pqr.z;
    float log2_opacity = inside ? float(splat.y >> 16 & 1023u) * (-FAINTEST / 1023.0) : -1.0e3;
    vec2 mean = vec2(splat.zw >> 12) * (1.0 / 128.0) - 2048.0;
    vec3 color = vec3(
        splat.z >> 2 & 1023u, splat.w >> 2 & 1023u,
        splat.y >> 26 << 4 | (splat.z & 3u) << 2 | (splat.w & 3u));

    // Down a column log2 alpha is a parabola in the row, so alpha itself follows from two ratios.
    // Start between rows 3 and 4: the low-pass filter keeps `bend` below 2.4, so a splat whose
    // alpha is under 2^-60 there reaches no row of this tile, and nothing over- or underflows.
    float dx = top.x - mean.x, dy = top.y + 3.5 - mean.y;
    float u = p * dx + q * dy, v = r * dy;
    float bend = q * q + r * r;
    float slope = 2.0 * (u * q + v * r);
    float middle = log2_opacity - u * u - v * v - 0.25 * bend;
    float first_up = middle + 0.5 * slope, first_down = middle - 0.5 * slope;
    float up = first_up < -60.0 ? 0.0 : exp2(first_up);
    float down = first_down < -60.0 ? 0.0 : exp2(first_down);
    float ratio_up = exp2(clamp(slope - 2.0 * bend, -12.0, 60.0));
    float ratio_down = exp2(clamp(-slope - 2.0 * bend, -12.0, 60.0));
    float ratio_of_ratios = exp2(-2.0 * bend);
    for (int k = 0; k < 4; k++) {
        add(3 - k, up, color);
        add(4 + k, down, color);
        up *= ratio_up;
        down *= ratio_down;
        ratio_up *= ratio_of_ratios;
        ratio_down *= ratio_of_ratios;
    }
}

void main() {
    uint tile = gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x;
    uvec2 corner = gl_WorkGroupID.xy * 8u;
    top = vec2(corner) + vec2(float(gl_LocalInvocationID.x) + 0.5, 0.5);
    for (int row = 0; row < 8; row++) acc[row] = vec4(0.0, 0.0, 0.0, 1.0);

    uint start = starts[tile], end = starts[tile + 1u], count = end - start;
    bool hidden = false;
    for (uint i = start & ~3u; i < end; i += 4u) {
        uvec4 four = pairs[i >> 2];
        // Unsigned, so that pairs of the tile before are outside too.
        blend(four.x, i - start < count);
        blend(four.y, i + 1u - start < count);
        blend(four.z, i + 2u - start < count);
        blend(four.w, i + 3u - start < count);
        float left = 0.0;
        for (int row = 0; row < 8; row++) left = max(left, acc[row].w);
        hidden = left < OPAQUE;
        if (hidden) break;
    }
    for (uint row = 0u; row < 8u; row++) {
        uvec2 pixel = corner + uvec2(gl_LocalInvocationID.x, row);
        if (pixel.x < size.x && pixel.y < size.y) {
            // What lies behind a hidden rest looks like what lies before it, not like the background.
            float left = hidden ? 0.0 : acc[row].w;
            float scale = (1.0 - left) / max(1.0 - acc[row].w, 1.0e-6) / 1023.0;
            vec3 rgb = acc[row].rgb * scale + left * background;
            pixels[pixel.y * size.x + pixel.x] = packUnorm4x8(vec4(rgb, 1.0 - left));
        }
    }
}
