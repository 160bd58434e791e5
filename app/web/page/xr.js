// Stereo in a headset: the head stands in front of the person, at eye height, facing them.

import { multiply, place } from "./camera.js";

const AHEAD = 0.7;   // m from the person to the head
const MM = 0.001;    // m

export class Headset {
  // `draw(modelView, projection, viewport)` draws one eye, `aim(modelView)` asks for a new order,
  // `posed(time, pose)` is told where the headset is. With `targets` those are drawn, and no head.
  constructor(gl, { draw, aim, isMirror, posed, ended }) {
    Object.assign(this, { gl, draw, aim, isMirror, posed, ended, session: null });
  }

  static async supported() {
    try {
      return await navigator.xr?.isSessionSupported("immersive-vr") ?? false;
    } catch {
      return false;
    }
  }

  async enter() {
    const session = await navigator.xr.requestSession("immersive-vr");
    try {
      await this.gl.makeXRCompatible();
      session.updateRenderState({
        baseLayer: new XRWebGLLayer(session, this.gl, { antialias: false, alpha: false }),
      });
      this.space = await session.requestReferenceSpace("local");
    } catch (error) {
      await session.end();  // else the headset stays dark
      throw error;
    }
    this.where = null;
    this.session = session;
    session.addEventListener("end", () => {
      this.session = null;
      this.ended();
    });
    session.requestAnimationFrame(this.frame);
  }

  leave() {
    return this.session?.end();
  }

  frame = (time, xr) => {
    const { session, gl } = this;
    if (!session) return;
    session.requestAnimationFrame(this.frame);
    const pose = xr.getViewerPose(this.space);
    this.posed(time, pose ?? null);
    if (!pose) return;
    this.where ??= inFront(pose.transform);
    const flip = this.isMirror() ? -1 : 1;
    const model = place(this.where.position, this.where.yaw, flip * MM, MM);
    const layer = session.renderState.baseLayer;
    gl.bindFramebuffer(gl.FRAMEBUFFER, layer.framebuffer);
    gl.clearColor(0.16, 0.16, 0.16, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    for (const view of pose.views) {
      const port = layer.getViewport(view);
      if (!port) continue;
      gl.viewport(port.x, port.y, port.width, port.height);
      if (this.targets) {
        const eye = multiply(view.transform.inverse.matrix, pose.transform.matrix);
        this.targets.draw(gl, port, view.projectionMatrix, eye);
        continue;
      }
      const modelView = multiply(view.transform.inverse.matrix, model);
      this.draw(modelView, view.projectionMatrix, port.width, port.height);
    }
    this.aim(multiply(pose.transform.inverse.matrix, model));
  };
}

function inFront({ position, matrix }) {
  const yaw = Math.atan2(matrix[8], matrix[10]);  // of the axis that points back at the person
  const { x, y, z } = position;
  return { yaw, position: [x - AHEAD * Math.sin(yaw), y, z - AHEAD * Math.cos(yaw)] };
}
