// Premultiplied colour of one splat at one pixel; blended back to front by the fixed pipeline.
#version 330
in vec2 uv;
flat in vec4 color;
out vec4 premultiplied;

const float CUTOFF = -6.0;  // log2 of the faintest alpha that is drawn, 1/64

void main() {
    float power = color.a - dot(uv, uv);
    if (power < CUTOFF) discard;
    float alpha = exp2(power);
    premultiplied = vec4(color.rgb * alpha, alpha);
}
