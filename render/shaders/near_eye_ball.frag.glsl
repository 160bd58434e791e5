// Eyeball: sclera with veins, cornea that refracts onto the iris, pupil, mirror images of the LEDs.
uniform vec3 gaze;
uniform vec3 across;   // unit, at right angles to the gaze
uniform float radius;
uniform float iris;    // mm
uniform float pupil;   // mm
uniform vec4 tones;    // sclera, iris, pupil, limbus softness
uniform float fibres;
uniform vec4 upper;  // lid margins: y = polynomial of x, highest power first
uniform vec4 lower;
const float CORNEA = 9.9;

float margin(vec4 c, float x) {
    return ((c.x * x + c.y) * x + c.z) * x + c.w;
}
float glints(vec3 at, vec3 n, vec3 view, float spread) {
    float sum = 0.0;
    vec3 mirrored = reflect(view, n);
    for (int k = 0; k < num_leds; k++) {
        vec3 way = normalize(leds[k] - at);
        float off = 1.0 - dot(mirrored, way);
        sum += exp(-off / spread);
    }
    return sum;
}
void main() {
    vec3 view = normalize(place - camera);
    vec3 n = normalize(place);
    vec3 up = cross(gaze, across);
    float rim = sqrt(radius * radius - iris * iris);
    float centre = rim - sqrt(CORNEA * CORNEA - iris * iris);
    vec3 c = gaze * centre;
    float b = dot(camera - c, view);
    float disc = b * b - dot(camera - c, camera - c) + CORNEA * CORNEA;
    float away = length(place - gaze * dot(place, gaze));
    float facing = dot(place, gaze);
    float edge = smoothstep(iris + tones.w, iris - tones.w, away) * step(0.0, facing);

    vec4 g = grain(place.xy * 0.8 + 3.0);
    float vein = abs(g.x - 0.5) * 2.0;
    float white = tones.x * (0.92 + 0.08 * vein) * (1.0 - 0.12 * smoothstep(0.12, 0.0, vein));
    white *= lamp;
    vec3 mirror = normalize(n + 0.08 * (vec3(g.y, g.w, 0.5) - 0.5));

    float inside = white;
    if (disc > 0.0 && edge > 0.0) {
        vec3 hit = camera + view * (-b - sqrt(disc));
        vec3 surface = normalize(hit - c);
        vec3 bent = refract(view, surface, 1.0 / 1.336);
        float plane = rim - 0.7;
        float depth = (plane - dot(hit, gaze)) / min(dot(bent, gaze), -0.05);
        vec3 on = hit + bent * depth;
        vec2 q = vec2(dot(on, across), dot(on, up));
        float rho = length(q);
        float turn = atan(q.y, q.x);
        // a turn is one period of the texture, so that the fibres meet
        vec4 fibre = texture(grains, vec2(turn / 6.2831853, rho * 0.012 + seed));
        float tone = tones.y * (1.0 + fibres * (1.3 * fibre.y + 0.6 * fibre.x - 0.95));
        tone *= 1.0 + 0.18 * exp(-pow((rho - pupil - 1.2) / 0.8, 2.0));
        tone *= 1.0 - 0.35 * smoothstep(iris - 1.3, iris, rho);
        tone = mix(tones.z, tone, smoothstep(pupil - 0.15, pupil + 0.15, rho + 0.12 * (fibre.x - 0.5)));
        inside = tone * lamp + 0.012;  // and the headset's faint light
        if (edge > 0.5) mirror = surface;
    }
    float result = mix(white, inside, edge);
    bool cornea = edge > 0.5;
    float glint = glints(place, mirror, view, cornea ? 0.0006 : 0.0018);
    float top = margin(upper, place.x) - place.y, bottom = place.y - margin(lower, place.x);
    result *= 0.45 + 0.55 * smoothstep(-0.5, 3.2, top);
    result *= 0.65 + 0.35 * smoothstep(-0.5, 1.5, bottom);
    float tear = exp(-pow((bottom - 0.35) / 0.3, 2.0)) * pow(grain(place.xy * 0.7).z, 2.0) * 2.0;
    result += glint * (cornea ? 6.0 : 1.2 * g.z);
    picture = vec4(result + 1.2 * tear * lamp, 0, 0, 1);
}
