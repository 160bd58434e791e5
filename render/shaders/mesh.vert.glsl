// The textured head: passes attributes on; the light is computed in the fragment shader.
#version 430
in vec3 position;   // mm
in vec3 normal;
in vec2 uv;
in vec3 color;      // linear tint of what has no texture; skin: gain of the albedo
in vec2 light_seen; // share of the sky and of the key light that is seen
in float kind;      // 0 skin, 1 eye, 2 coloured (gums, tongue, mouth), 3 teeth, 4 lashes
uniform mat4 transform;
out vec3 v_normal;
out vec2 v_uv;
out vec3 v_color;
out vec2 v_light_seen;
flat out int v_kind;

void main() {
    gl_Position = transform * vec4(position, 1.0);
    v_normal = normal;
    v_uv = uv;
    v_color = color;
    v_light_seen = light_seen;
    v_kind = int(kind + 0.5);
}
