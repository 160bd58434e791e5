// One splat an instance: the parallelogram |u| <= R, |v| <= R around the ellipse u^2 + v^2 <= R^2.
in uvec4 words;  // instances come farthest first

uniform vec2 size;  // px

out vec2 uv;
flat out vec4 color;  // rgb, log2 of the opacity

void main() {
    Splat splat = unpack(words);
    float radius = sqrt(splat.log2_opacity + FAINTEST);
    uv = radius * vec2((gl_VertexID & 1) * 2 - 1, (gl_VertexID >> 1) * 2 - 1);
    float dy = uv.y / splat.r;
    float dx = (uv.x - splat.q * dy) / splat.p;
    color = vec4(splat.color / 1023.0, splat.log2_opacity);
    // y is not flipped: row 0 of the framebuffer is the top of the picture.
    gl_Position = vec4((splat.xy + vec2(dx, dy)) / size * 2.0 - 1.0, 0.0, 1.0);
}
