// Skin in infrared: bright and even (melanin hardly absorbs), scattering, with a wet grainy shine.
uniform float albedo;
uniform float gloss;
uniform float pores;
uniform vec4 crease;  // centre xyz (rest), depth: darker towards the inner corner
void main() {
    vec4 g = grain(rest.xy + 0.3 * rest.z);
    vec3 bump = vec3(g.y, g.w, g.z) - 0.5;
    vec3 rough = normalize(normal + 1.1 * pores * bump);
    vec3 to_eye = normalize(camera - place);
    float shine = 0.0;
    for (int k = 0; k < 3; k++) {  // three of the lamps are enough for a wet look
        vec3 way = leds[k] - place;
        float near = inversesqrt(dot(way, way));
        shine += power48(max(dot(rough, normalize(way * near + to_eye)), 0.0)) * near * near;
    }
    shine *= led_power * float(num_leds) / 3.0;
    float tone = albedo * (0.84 + 0.2 * g.x + 0.16 * (g.z - 0.5));
    tone *= 1.0 + 0.5 * pores * (bump.x + bump.y) * 0.4;
    vec3 away = rest - crease.xyz;
    tone *= 1.0 - crease.w * exp(-dot(away, away) / 30.0);
    float light = tone * (lamp + 0.05) + gloss * shine * (0.2 + 3.0 * g.z * g.w);
    picture = vec4(light, 0, 0, 1);
}
