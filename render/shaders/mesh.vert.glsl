// The textured head: passes attributes on; the light is computed in the fragment shader.
#version 330
in vec3 position;  // mm
in vec3 normal;
in vec2 uv;
in vec3 color;     // stored: of what has no texture; skin: gain of the albedo
in vec4 seen;      // shares of the sky, of the key light and the rims that are seen
in float kind;     // 0 skin, 1 eye, 2 coloured (gums, tongue, mouth), 3 teeth
uniform mat4 transform;
out vec3 v_position;
out vec3 v_normal;
out vec2 v_uv;
out vec3 v_color;
out vec4 v_seen;
flat out int v_kind;

void main() {
    gl_Position = transform * vec4(position, 1.0);
    v_position = position;
    v_normal = normal;
    v_uv = uv;
    v_color = color;
    v_seen = seen;
    v_kind = int(kind + 0.5);
}
