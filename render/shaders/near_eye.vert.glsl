#version 330
// Skin, eyeball and hair of the near-eye pictures; all in eye space (mm, origin = eyeball centre).
// The lamps' diffuse light is summed here: the meshes are fine enough, and llvmpipe is slow.
uniform mat4 to_clip;
uniform vec3 leds[8];
uniform int num_leds;
uniform float led_power;
uniform vec3 camera;
in vec3 in_place;
in vec3 in_normal;  // zero: hair, lit from everywhere
in vec3 in_rest;    // skin: where it lies at rest, so that its grain moves with it; hair: shade, opacity
out vec3 place;
out vec3 normal;
out vec3 rest;
out float lamp;
void main() {
    place = in_place;
    normal = dot(in_normal, camera - in_place) < 0.0 ? -in_normal : in_normal;
    rest = in_rest;
    bool hair = dot(in_normal, in_normal) < 0.5;
    lamp = 0.0;
    for (int k = 0; k < num_leds; k++) {
        vec3 way = leds[k] - in_place;
        float near2 = dot(way, way);
        float facing = hair ? 1.0 : max(dot(normal, way * inversesqrt(near2)) + 0.25, 0.0) * 0.8;
        lamp += led_power / (near2 + 250.0) * facing;
    }
    gl_Position = to_clip * vec4(in_place, 1.0);
}
