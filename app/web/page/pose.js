// The pose of this headset to livedrive: time in ms, position in m and quaternion xyzw of WebXR, and
// whether it is tracked; nine float64, little-endian.

const MAX_WAITING = 1000;  // bytes that may wait in the socket: what does not fit is left out

export class PoseSender {
  constructor(address) {
    Object.assign(this, { address, socket: null, sent: 0 });
  }

  start() {
    this.stop();
    this.socket = new WebSocket(this.address);
  }

  // `pose`: an XRViewerPose, or null where the headset has lost itself.
  send(time, pose) {
    const { socket } = this;
    if (!socket || socket.readyState !== WebSocket.OPEN || socket.bufferedAmount > MAX_WAITING) return;
    if (pose) {
      const { position: p, orientation: q } = pose.transform;
      this.last = [p.x, p.y, p.z, q.x, q.y, q.z, q.w];
    }
    if (!this.last) return;
    const view = new DataView(new ArrayBuffer(72));
    [time, ...this.last, pose ? 1 : 0].forEach((v, k) => view.setFloat64(8 * k, v, true));
    socket.send(view.buffer);
    this.sent++;
  }

  stop() {
    this.socket?.close();
    this.socket = null;
  }
}
