// Splats, sorted by tile and depth -> picture. One lane a tile of 8x8 px: lanes of a software driver
// share a vector register and load one after the other, so eight tiles share the cost of a load,
// which is more than that of 64 pixels. Tiles come by length of their lists, so lanes end together.
layout(local_size_x = 8) in;

layout(std430, binding = 0) readonly buffer Splats { uvec4 splats[]; };
layout(std430, binding = 1) readonly buffer Pairs { uint pairs[]; };     // tile after tile, nearest first
layout(std430, binding = 2) readonly buffer Starts { uint starts[]; };  // tile -> first pair; lists are one apart
layout(std430, binding = 3) readonly buffer Tiles { uint tiles[]; };     // lane -> tile
layout(std430, binding = 4) writeonly buffer Needs { uint needs[]; };  // tile -> pairs it looked at
layout(std430, binding = 5) writeonly buffer Pixels { uint pixels[]; };  // RGBA8, top row first

uniform uvec2 size;      // px
uniform uint tiles_across;
uniform vec3 background;

const float CUTOFF = 1.0 / 64.0;  // the faintest alpha that is drawn
const float OPAQUE = 1.0 / 128.0;  // a tile this opaque hides the rest

vec4 acc[64];  // column after column: colour in 0..1023, transmittance

// A splat as seen from one tile. Down a column log2 alpha is a parabola in the row, so alpha follows
// from two ratios; along a row those ratios grow by a constant factor. Columns start between rows 3
// and 4: the low-pass filter keeps `bend` below 4.81, so a splat whose alpha is under 2^-103 there
// reaches no row of the column, and nothing over- or underflows.
struct Seen {
    float p, q, r;
    float u, v;         // at the start of the column
    float middle;       // log2 alpha there, less -u^2
    float bend;
    vec2 ratio;         // of alpha from row to row, upwards and downwards
    vec2 ratio_growth;  // from column to column
    float ratio_decay;  // from row to row
    vec3 color;
};

// 2^x to 1e-4, for |x| < 126: half the instructions of the driver's.
vec2 power_of_two(vec2 x) {
    vec2 whole = roundEven(x), f = x - whole;
    vec2 y = 1.0 + f * (0.69315 + f * (0.24022 + f * 0.0558));
    return intBitsToFloat(floatBitsToInt(y) + (ivec2(whole) << 23));
}

Seen load(uint i, uint end, vec2 start) {
    Splat splat = unpack(splats[pairs[min(i, end - 1u)]]);
    Seen s;
    s.p = splat.p, s.q = splat.q, s.r = splat.r;
    vec2 d = start - splat.xy;
    s.u = s.p * d.x + s.q * d.y, s.v = s.r * d.y;
    s.bend = s.q * s.q + s.r * s.r;
    s.middle = (i < end ? splat.log2_opacity : -1.0e3) - s.v * s.v - 0.25 * s.bend;
    float slope = 2.0 * (s.u * s.q + s.v * s.r);
    s.ratio = power_of_two(clamp(vec2(slope, -slope) - 2.0 * s.bend, -90.0, 90.0));
    s.ratio_growth = power_of_two(vec2(2.0, -2.0) * (s.p * s.q));
    s.ratio_decay = exp2(-2.0 * s.bend);
    s.color = splat.color;
    return s;
}

vec2 first_alphas(Seen s) {
    float slope = s.u * s.q + s.v * s.r;
    vec2 power = vec2(slope, -slope) + s.middle - s.u * s.u;
    return mix(power_of_two(max(power, -103.0)), vec2(0.0), lessThan(power, vec2(-103.0)));
}

void add(int pixel, float alpha, vec3 color) {
    float weight = alpha < CUTOFF ? 0.0 : alpha * acc[pixel].w;
    acc[pixel].rgb += weight * color;
    acc[pixel].w -= weight;
}

void blend(int x, inout Seen a, inout Seen b) {  // one column; a is in front of b
    vec2 alpha_a = first_alphas(a), alpha_b = first_alphas(b);
    vec2 ratio_a = max(a.ratio, 1.0 / 4096.0), ratio_b = max(b.ratio, 1.0 / 4096.0);
    for (int k = 0; k < 4; k++) {
        add(x + 3 - k, alpha_a.x, a.color);
        add(x + 3 - k, alpha_b.x, b.color);
        add(x + 4 + k, alpha_a.y, a.color);
        add(x + 4 + k, alpha_b.y, b.color);
        alpha_a *= ratio_a, alpha_b *= ratio_b;
        ratio_a *= a.ratio_decay, ratio_b *= b.ratio_decay;
    }
    a.u += a.p, b.u += b.p;
    a.ratio *= a.ratio_growth, b.ratio *= b.ratio_growth;
}

void store(vec4 color, bool hidden, uvec2 at) {
    // What lies behind a hidden rest looks like what lies before it, not like the background.
    float left = hidden ? 0.0 : color.w;
    float scale = (1.0 - left) / max(1.0 - color.w, 1.0e-6) / 1023.0;
    uint rgba = packUnorm4x8(vec4(color.rgb * scale + left * background, 1.0 - left));
    if (at.x < size.x && at.y < size.y) pixels[at.y * size.x + at.x] = rgba;
}

// The eight columns by name, not in a loop: only a constant index keeps `acc` in registers, and
// drivers do not unroll 64 pixels.
#define EIGHT(column) \
    column(0) column(8) column(16) column(24) column(32) column(40) column(48) column(56)

void main() {
    uint tile = tiles[gl_GlobalInvocationID.x];
    uvec2 corner = 8u * uvec2(tile % tiles_across, tile / tiles_across);
    vec2 start = vec2(corner) + vec2(0.5, 4.0);
#define CLEAR(x) for (int row = 0; row < 8; row++) acc[x + row] = vec4(0.0, 0.0, 0.0, 1.0);
    EIGHT(CLEAR)

    uint end = starts[tile + 1u] - 1u;
    bool hidden = false;
    uint looked = 0xffffffffu;
    for (uint i = starts[tile]; i < end; i += 2u) {
        Seen a = load(i, end, start), b = load(i + 1u, end, start);  // a is in front of b
#define BLEND(x) blend(x, a, b);
        EIGHT(BLEND)
        float left = 0.0;
#define LEFT(x) for (int row = 0; row < 8; row++) left = max(left, acc[x + row].w);
        EIGHT(LEFT)
        hidden = left < OPAQUE;
        if (hidden) {
            looked = i + 2u - starts[tile];
            break;
        }
    }
    needs[tile] = looked;
#define STORE(x) \
    for (int row = 0; row < 8; row++) store(acc[x + row], hidden, corner + uvec2(x / 8, row));
    EIGHT(STORE)
}
