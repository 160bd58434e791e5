// A splat, packed by project.comp.glsl and read by what draws it: 16 bytes, because blending on a CPU
// waits for loads. Prepended to those shaders.
#version 430

const float FAINTEST = 6.0;  // -log2 of the faintest alpha that is drawn

// alpha = exp2(log2_opacity - u^2 - v^2), u = p dx + q dy, v = r dy: the Cholesky factor of the
// inverse covariance keeps long thin splats exact where the inverse itself would cancel.
struct Splat {
    vec2 xy;  // px
    float p, q, r;
    float log2_opacity;
    vec3 color;  // 0..1023
};

// The bits of a positive float from `least` (a biased exponent) on, 11 of its mantissa, rounded.
uint shorten(float x, uint least, uint most) {
    uint bits = max(floatBitsToUint(x) + 0x800u, least << 23) - (least << 23);
    return min(bits >> 12, most);
}

// p, r in 16 bits each: 5 of exponent from 2^-30, 11 of mantissa; q: sign, 4 from 2^-13, 11. No half
// floats: software drivers take a dozen instructions to widen one. Position in 1/128 px from -2048;
// colours and -log2 opacity in 10 bits.
uvec4 pack(Splat s) {
    uvec2 at = uvec2(clamp(round((s.xy + 2048.0) * 128.0), 0.0, 1048575.0));
    uvec3 rgb = uvec3(round(clamp(s.color, 0.0, 1023.0)));
    uint faint = uint(round(clamp(-s.log2_opacity / FAINTEST, 0.0, 1.0) * 1023.0));
    uint q = shorten(abs(s.q), 114u, 0x7fffu) | (s.q < 0.0 ? 0x8000u : 0u);
    return uvec4(
        shorten(s.p, 97u, 0xffffu) | q << 16,
        shorten(s.r, 97u, 0xffffu) | faint << 16 | (rgb.b >> 4) << 26,
        at.x << 12 | rgb.r << 2 | (rgb.b >> 2 & 3u),
        at.y << 12 | rgb.g << 2 | (rgb.b & 3u));
}

Splat unpack(uvec4 word) {
    Splat s;
    s.xy = vec2(word.zw >> 12) * (1.0 / 128.0) - 2048.0;
    s.p = uintBitsToFloat(((word.x & 0xffffu) << 12) + (97u << 23));
    s.q = uintBitsToFloat(
        (word.x >> 16 << 12 & 0x7ffffffu) + (114u << 23) | word.x & 0x80000000u);
    s.r = uintBitsToFloat(((word.y & 0xffffu) << 12) + (97u << 23));
    s.log2_opacity = float(word.y >> 16 & 1023u) * (-FAINTEST / 1023.0);
    s.color = vec3(
        word.z >> 2 & 1023u, word.w >> 2 & 1023u,
        word.y >> 26 << 4 | (word.z & 3u) << 2 | (word.w & 3u));
    return s;
}
