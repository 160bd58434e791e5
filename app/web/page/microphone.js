// The microphone of this device as a source of livedrive: untouched sound, counted.

import { Line } from "./line.js";

const RATE = 48000;
const MAX_WAITING = RATE;  // bytes that may wait in the socket: a quarter of a second

export class Microphone {
  constructor(address, changed) {
    Object.assign(this, { address, changed, sent: 0, skipped: 0 });
    Object.assign(this, { stream: null, context: null, line: null, starting: false });
  }

  get on() {
    return this.line !== null;
  }

  async start() {
    if (this.starting) return;  // the browser still asks for permission
    this.starting = true;
    try {
      await this.open();
    } catch (error) {
      await this.stop();  // whatever has been opened
      throw error;
    } finally {
      this.starting = false;
    }
    this.changed("");
  }

  async open() {
    this.stream = await navigator.mediaDevices.getUserMedia({
      audio: {
        channelCount: 1, sampleRate: RATE,
        echoCancellation: false, noiseSuppression: false, autoGainControl: false,
      },
    });
    this.context = new AudioContext({ sampleRate: RATE, latencyHint: "interactive" });
    await this.context.audioWorklet.addModule("chunks.js");
    const gone = () => this.stop("microphone: the device has gone");
    this.stream.getTracks().forEach((track) => { track.onended = gone; });
    this.context.onstatechange = () => this.context?.state === "interrupted" && this.context.resume();
    const node = new AudioWorkletNode(this.context, "chunks", {
      numberOfInputs: 1, numberOfOutputs: 0, channelCount: 1, channelCountMode: "explicit",
    });
    node.port.onmessage = ({ data }) => this.send(data);
    this.context.createMediaStreamSource(this.stream).connect(node);
    const ended = (reason) => this.stop(`microphone: ${reason || "livedrive is gone"}`);
    this.line = new Line(this.address, ended);
  }

  // What does not fit is left out; the counter tells the receiver.
  send({ first, samples }) {
    if (!this.line?.takes(MAX_WAITING)) {
      this.skipped++;
      return;
    }
    const message = new ArrayBuffer(8 + samples.byteLength);
    new DataView(message).setBigInt64(0, BigInt(first), true);
    new Float32Array(message, 8).set(samples);
    this.line.send(message);
    this.sent++;
  }

  async stop(problem = "") {
    const { context, stream, line } = this;
    if (!stream) return;
    Object.assign(this, { stream: null, context: null, line: null });
    line?.close();
    stream.getTracks().forEach((track) => track.stop());
    await context?.close();
    this.changed(problem);
  }
}
