// The pose of this headset to livedrive: time in ms, position in m and quaternion xyzw of WebXR, and
// whether it is tracked; nine float64, little-endian.

import { Line } from "./line.js";

const MAX_WAITING = 1000;  // bytes that may wait in the socket: what does not fit is left out

export class PoseSender {
  // `refused(problem)`: livedrive does not take them.
  constructor(address, refused) {
    Object.assign(this, { address, refused, line: null, sent: 0 });
  }

  start() {
    this.stop();
    this.line = new Line(this.address, (reason) => this.refused(`head: ${reason || "livedrive is gone"}`));
  }

  // `pose`: an XRViewerPose, or null where the headset has lost itself.
  send(time, pose) {
    if (!this.line?.takes(MAX_WAITING)) return;
    if (pose) {
      const { position: p, orientation: q } = pose.transform;
      this.last = [p.x, p.y, p.z, q.x, q.y, q.z, q.w];
    }
    if (!this.last) return;
    const view = new DataView(new ArrayBuffer(72));
    [time, ...this.last, pose ? 1 : 0].forEach((v, k) => view.setFloat64(8 * k, v, true));
    this.line.send(view.buffer);
    this.sent++;
  }

  stop() {
    this.line?.close();
    this.line = null;
  }
}
