// The microphone of this device as a source of livedrive: untouched sound, counted.

const RATE = 48000;
const MAX_WAITING = RATE;  // bytes that may wait in the socket: a quarter of a second

export class Microphone {
  constructor(address, changed) {
    Object.assign(this, { address, changed, context: null, sent: 0, skipped: 0 });
  }

  get on() {
    return this.context !== null;
  }

  async start() {
    const stream = await navigator.mediaDevices.getUserMedia({
      audio: {
        channelCount: 1, sampleRate: RATE,
        echoCancellation: false, noiseSuppression: false, autoGainControl: false,
      },
    });
    this.context = new AudioContext({ sampleRate: RATE, latencyHint: "interactive" });
    await this.context.audioWorklet.addModule("chunks.js");
    const node = new AudioWorkletNode(this.context, "chunks", {
      numberOfInputs: 1, numberOfOutputs: 0, channelCount: 1, channelCountMode: "explicit",
    });
    this.stream = stream;
    this.socket = new WebSocket(this.address);
    this.socket.onclose = ({ reason }) => this.stop(`microphone: ${reason || "the run has ended"}`);
    node.port.onmessage = ({ data }) => this.send(data);
    this.context.createMediaStreamSource(stream).connect(node);
    this.changed("");
  }

  // What does not fit is left out; the counter tells the receiver.
  send({ first, samples }) {
    if (this.socket.readyState !== WebSocket.OPEN || this.socket.bufferedAmount > MAX_WAITING) {
      this.skipped++;
      return;
    }
    const message = new ArrayBuffer(8 + samples.byteLength);
    new DataView(message).setBigInt64(0, BigInt(first), true);
    new Float32Array(message, 8).set(samples);
    this.socket.send(message);
    this.sent++;
  }

  async stop(problem = "") {
    const { context, stream, socket } = this;
    if (!context) return;
    this.context = null;
    socket.onclose = null;
    socket.close();
    stream.getTracks().forEach((track) => track.stop());
    await context.close();
    this.changed(problem);
  }
}
