// AudioWorklet: plays what comes, 80 ms late, so that an uneven network is not heard.

const HELD = 3840;       // samples that wait before it begins, also after it has run dry
const MOST = 3 * HELD;   // more than that is skipped: the page must not fall behind the faces
const SIZE = 1 << 15;
const TELL = 4800;       // samples between two reports of the level

registerProcessor("player", class extends AudioWorkletProcessor {
  constructor() {
    super();
    this.ring = new Float32Array(SIZE);
    this.come = this.played = this.told = this.peak = 0;  // samples
    this.playing = false;
    this.port.onmessage = ({ data }) => this.take(new Int16Array(data));
  }

  take(samples) {
    for (const value of samples) this.ring[this.come++ % SIZE] = value / 32768;
    if (this.come - this.played > MOST) this.played = this.come - HELD;
  }

  process(_, [[out]]) {
    const waiting = this.come - this.played;
    this.playing = waiting >= (this.playing ? out.length : HELD);
    if (!this.playing) return true;
    for (let k = 0; k < out.length; k++) {
      out[k] = this.ring[this.played++ % SIZE];
      this.peak = Math.max(this.peak, Math.abs(out[k]));
    }
    if (this.played - this.told > TELL) {
      this.port.postMessage(this.peak);
      [this.told, this.peak] = [this.played, 0];
    }
    return true;
  }
});
