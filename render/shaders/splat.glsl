// A splat as render/splats/projection_kernels.py packs it: 16 bytes, because blending on a CPU waits
// for loads. Prepended, after the version, to the shaders that draw it.
const float FAINTEST = 6.0;  // -log2 of the faintest alpha that is drawn

// alpha = exp2(log2_opacity - u^2 - v^2), u = p dx + q dy, v = r dy: the Cholesky factor of the
// inverse covariance keeps long thin splats exact where the inverse itself would cancel.
struct Splat {
    vec2 xy;  // px
    float p, q, r;
    float log2_opacity;
    vec3 color;  // 0..1023
};

// p, r in 16 bits each: 5 of exponent from 2^-30, 11 of mantissa; q: sign, 4 from 2^-13, 11. No half
// floats: software drivers take a dozen instructions to widen one. Position in 1/128 px from -2048;
// colours and -log2 opacity in 10 bits.
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
