// What Gaussians mirror, one lobe each, as render/splats/shine.py computes it: skin shows the lamps
// where its normal lies half-way between lamp and viewer.

export const SHINE = `
uniform usampler2D weights;    // of each lamp's light, bytes
uniform usampler2D roughness;  // bytes
uniform int mirrors;           // how many Gaussians do, the first ones
uniform vec4 lamps[4];         // where they are, and what their width adds to the roughness
uniform vec3 lights[4];        // linear
uniform float film[5];

const float F0 = 0.028;
const float WEIGHT = 2.0 / 255.0;

// Stored colour of a Gaussian with a normal, seen along view (both in the head's frame, unit).
vec3 mirrored(vec3 color, int index, ivec2 at, vec3 normal, vec3 view) {
  if (index >= mirrors || dot(normal, view) <= 0.0) return color;
  vec4 share = vec4(texelFetch(weights, at, 0)) * WEIGHT;
  float rough_base = float(texelFetch(roughness, at, 0).x) / 255.0;
  vec3 more = vec3(0.0);
  for (int k = 0; k < 4; k++) {
    float facing = dot(normal, lamps[k].xyz);
    if (facing <= 0.0) continue;
    vec3 half_way = lamps[k].xyz + view;
    float square = dot(half_way, half_way) + 1e-9;  // 4 (l . h)^2
    float near = dot(normal, half_way) * inversesqrt(square);
    float rough = min(rough_base + lamps[k].w, 1.0);
    float a2 = rough * rough * rough * rough;
    float spread = near * near * (a2 - 1.0) + 1.0;
    float out_ = 1.0 - sqrt(0.25 * square);
    float fresnel = F0 + (1.0 - F0) * out_ * out_ * out_ * out_ * out_;
    more += lights[k] * (share[k] * a2 * fresnel * facing
      / (spread * spread * 4.0 * max(0.25 * square, 0.1) * (rough + 0.5)));
  }
  vec3 r = color * color;  // x (a x + b) / (x (c x + d) + e), solved for x
  vec3 p = film[0] - film[2] * r, q = film[1] - film[3] * r;
  vec3 x = more + (sqrt(q * q + 4.0 * p * film[4] * r) - q) / (2.0 * p);
  x = x * (film[0] * x + film[1]) / (x * (film[2] * x + film[3]) + film[4]);
  return sqrt(min(x, 1.0));
}
`;
