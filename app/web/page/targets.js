// Where to look while the eyes are calibrated: a dot at known angles, on a screen or in a headset.
// The run begins as soon as a page listens, which it does once somebody has pressed a button.

const SCREEN_PX = 2270;  // from the eyes to the screen: 60 cm of 96 pixels an inch
const AWAY = 10;         // m to the dot in a headset: both eyes look ahead in parallel
const SIZE = 0.012;      // of the dot, as a share of its distance

export class Targets {
  // `say(text)` shows what else is to be done; `ended()`: it may be started again.
  constructor(address, dot, say, ended) {
    Object.assign(this, { address, dot, say, ended, socket: null, target: null });
  }

  start() {
    if (this.socket) return;
    this.socket = new WebSocket(this.address);
    this.socket.onmessage = ({ data }) => this.show(JSON.parse(data));
    this.socket.onclose = () => {
      const done = this.target?.name === "close";
      this.socket = null;
      this.show(null);
      this.ended();
      this.say(`${done ? "done" : "stopped"}: back to the terminal`);
    };
    this.say("look straight ahead");
  }

  get isShown() {
    return this.target?.name === "look";
  }

  show(target) {
    this.target = target;
    const [x, y] = this.isShown ? direction(target) : [0, 0];
    this.dot.hidden = !this.isShown;
    this.dot.style.transform = `translate(${x * SCREEN_PX}px, ${-y * SCREEN_PX}px)`;
    if (target) this.say(target.words);
  }

  // Into one eye's viewport of a headset; `eye` is that eye in the space of the head.
  draw(gl, port, projection, eye) {
    if (!this.isShown) return;
    const [x, y] = direction(this.target);
    const at = [x * AWAY, y * AWAY, -AWAY, 1];
    const [cx, cy, , w] = apply(projection, apply(eye, at));
    if (w <= 0) return;
    const side = Math.max(6, Math.round(SIZE * port.width * projection[0] / 2));
    const [left, low] = [port.x + (1 + cx / w) * port.width / 2, port.y + (1 + cy / w) * port.height / 2];
    gl.enable(gl.SCISSOR_TEST);
    for (const [size, grey] of [[side, 1], [side / 3, 0]]) {
      gl.scissor(Math.round(left - size / 2), Math.round(low - size / 2), Math.ceil(size), Math.ceil(size));
      gl.clearColor(grey, grey, grey, 1);
      gl.clear(gl.COLOR_BUFFER_BIT);
    }
    gl.disable(gl.SCISSOR_TEST);
  }
}

// Right and up, of one ahead; degrees to the person's left and up.
function direction({ yaw_deg, pitch_deg }) {
  const [yaw, pitch] = [yaw_deg, pitch_deg].map((degrees) => degrees * Math.PI / 180);
  return [-Math.tan(yaw), Math.tan(pitch) / Math.cos(yaw)];
}

function apply(matrix, point) {
  return [0, 1, 2, 3].map((row) => point.reduce((sum, v, k) => sum + matrix[4 * k + row] * v, 0));
}
