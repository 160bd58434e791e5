// Lashes and brows: ribbons; rest = (shade, opacity, 0).
void main() {
    picture = vec4(rest.x * lamp, 0, 0, rest.y);
}
