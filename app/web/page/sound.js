// The voices of a call at this page: 10 ms of 48 kHz a message, played as an even stream.

const RATE = 48000;

export class Sound {
  // `changed(problem)` is told when it begins and ends.
  constructor(address, changed) {
    Object.assign(this, { address, changed, context: null, level: 0 });
  }

  get on() {
    return this.context !== null;
  }

  async start() {
    this.context = new AudioContext({ sampleRate: RATE, latencyHint: "interactive" });
    await this.context.audioWorklet.addModule("player.js");
    this.node = new AudioWorkletNode(this.context, "player", {
      numberOfInputs: 0, numberOfOutputs: 1, outputChannelCount: [1],
    });
    this.node.port.onmessage = ({ data }) => this.level = data;
    this.node.connect(this.context.destination);
    this.socket = new WebSocket(this.address);
    this.socket.binaryType = "arraybuffer";
    this.socket.onmessage = ({ data }) => this.node.port.postMessage(data, [data]);
    this.socket.onclose = () => this.stop("sound: the call has ended");
    this.changed("");
  }

  async stop(problem = "") {
    const { context, socket } = this;
    if (!context) return;
    this.context = null;
    socket.onclose = null;
    socket.close();
    await context.close();
    this.changed(problem);
  }
}
