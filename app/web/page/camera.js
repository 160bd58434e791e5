// Matrices, column-major as WebGL takes them, and the camera that a hand turns around the head.
// The picture at rest is that of render/cameras.py: portrait.

const CENTRE = [0, 15, 0];  // mm
const SPAN = 320;           // mm that the shorter side of the picture shows
const DISTANCE = 900;       // mm

export function multiply(a, b) {
  const out = new Float32Array(16);
  for (let column = 0; column < 4; column++)
    for (let row = 0; row < 4; row++)
      for (let k = 0; k < 4; k++) out[4 * column + row] += a[4 * k + row] * b[4 * column + k];
  return out;
}

// Scale first, then turn about y, then move.
export function place(position, yaw, scaleX, scale) {
  const c = Math.cos(yaw), s = Math.sin(yaw);
  return new Float32Array([
    c * scaleX, 0, -s * scaleX, 0, 0, scale, 0, 0, s * scale, 0, c * scale, 0, ...position, 1]);
}

// Where the viewer is, in the space of the model; the matrix turns, mirrors, moves and scales alike.
export function position(modelView) {
  const m = modelView, square = m[0] * m[0] + m[1] * m[1] + m[2] * m[2];
  return [0, 4, 8].map((k) => -(m[k] * m[12] + m[k + 1] * m[13] + m[k + 2] * m[14]) / square);
}

export class Orbit {
  constructor() {
    this.yaw = this.pitch = 0;  // rad, towards the subject's left, upwards
    this.zoom = 1;
  }

  turn(dx, dy) {
    this.yaw -= dx * 0.006;
    this.pitch = Math.max(-1.4, Math.min(1.4, this.pitch + dy * 0.006));
  }

  scale(factor) {
    this.zoom = Math.max(0.4, Math.min(8, this.zoom * factor));
  }

  view() {
    const [cy, sy] = [Math.cos(this.yaw), Math.sin(this.yaw)];
    const [cp, sp] = [Math.cos(this.pitch), Math.sin(this.pitch)];
    // Rows of the rotation: the camera's right, its up, and back towards the camera.
    const right = [cy, 0, -sy], up = [-sp * sy, cp, -sp * cy], back = [cp * sy, sp, cp * cy];
    const dot = (u) => u[0] * CENTRE[0] + u[1] * CENTRE[1] + u[2] * CENTRE[2];
    return new Float32Array([
      right[0], up[0], back[0], 0, right[1], up[1], back[1], 0, right[2], up[2], back[2], 0,
      -dot(right), -dot(up), -dot(back) - DISTANCE, 1]);
  }

  projection(width, height) {
    const focal = this.zoom * Math.min(width, height) * DISTANCE / SPAN;  // px
    const near = 10, far = 10000;
    return new Float32Array([
      2 * focal / width, 0, 0, 0, 0, 2 * focal / height, 0, 0,
      0, 0, (far + near) / (near - far), -1, 0, 0, 2 * far * near / (near - far), 0]);
  }
}
