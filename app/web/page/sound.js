// The voices of a call at this page: 10 ms of 48 kHz a message, played as an even stream.

import { Line } from "./line.js";

const RATE = 48000;

export class Sound {
  // `changed(problem)` is told when it begins and ends.
  constructor(address, changed) {
    Object.assign(this, { address, changed, context: null, line: null, level: 0 });
  }

  get on() {
    return this.context !== null;
  }

  async start() {
    const context = this.context = new AudioContext({ sampleRate: RATE, latencyHint: "interactive" });
    context.onstatechange = () => context.state === "interrupted" && context.resume();  // by a call
    try {
      await context.audioWorklet.addModule("player.js");
    } catch (error) {
      await this.stop();
      throw error;
    }
    if (this.context !== context) return;  // switched off meanwhile
    const node = this.node = new AudioWorkletNode(context, "player", {
      numberOfInputs: 0, numberOfOutputs: 1, outputChannelCount: [1],
    });
    node.port.onmessage = ({ data }) => this.level = data;
    node.connect(context.destination);
    this.line = new Line(this.address, () => this.stop("sound: the call has ended"), (socket) => {
      socket.binaryType = "arraybuffer";
      socket.onmessage = ({ data }) => node.port.postMessage(data, [data]);
    });
    this.changed("");
  }

  async stop(problem = "") {
    const { context, line } = this;
    if (!context) return;
    Object.assign(this, { context: null, line: null });
    line?.close();
    await context.close();
    this.changed(problem);
  }
}
