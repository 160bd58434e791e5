#version 330
in vec3 place;
in vec3 normal;
in vec3 rest;
in float lamp;  // what the lamps shed here
out vec4 picture;  // infrared light in red, coverage in alpha
uniform vec3 camera;
uniform vec3 leds[8];
uniform int num_leds;
uniform float led_power;
uniform float seed;

uniform sampler2D grains;  // red, green: soft and fine noise; blue, alpha: pores and their slope

vec4 grain(vec2 mm) {  // the texture repeats after 40 mm
    return texture(grains, mm / 40.0 + seed);
}
float power48(float x) {
    float x2 = x * x, x4 = x2 * x2, x8 = x4 * x4, x16 = x8 * x8;
    return x16 * x16 * x16;
}
