// AudioWorklet: 480 samples (10 ms) a message, with the count of samples before them.

const SIZE = 480;

registerProcessor("chunks", class extends AudioWorkletProcessor {
  constructor() {
    super();
    this.samples = new Float32Array(SIZE);
    this.fill = 0;
    this.first = 0;
    this.next = null;  // frame that the next block should start at
  }

  process([input]) {
    const block = input[0];
    if (!block) return true;  // not connected yet
    if (this.next !== null && currentFrame > this.next) {  // blocks were skipped: so is the count
      this.flush();
      this.first += currentFrame - this.next;
    }
    this.next = currentFrame + block.length;
    for (let done = 0; done < block.length;) {
      const part = block.subarray(done, done + SIZE - this.fill);
      this.samples.set(part, this.fill);
      this.fill += part.length;
      done += part.length;
      if (this.fill === SIZE) this.flush();
    }
    return true;
  }

  flush() {
    if (!this.fill) return;
    const samples = this.samples.slice(0, this.fill);
    this.port.postMessage({ first: this.first, samples }, [samples.buffer]);
    this.first += this.fill;
    this.fill = 0;
  }
});
