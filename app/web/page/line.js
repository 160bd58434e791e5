// A WebSocket of something that is switched on: when it is lost, it is dialled again for a while.

const RETRY_MS = 1000;
const STEADY_MS = 1000;  // a line that is refused is closed sooner
const TRIES = 60;

export class Line {
  // `ended(reason)`: it was refused at once, or does not come back; `begun(socket)`: a new socket.
  constructor(address, ended, begun = () => {}) {
    Object.assign(this, { address, ended, begun, left: 0 });
    this.dial();
  }

  // What does not fit may be left out.
  takes(waiting) {
    return this.socket.readyState === WebSocket.OPEN && this.socket.bufferedAmount <= waiting;
  }

  send(message) {
    this.socket.send(message);
  }

  close() {
    this.closed = true;
    clearTimeout(this.waiting);
    this.socket.close();
  }

  dial() {
    const socket = this.socket = new WebSocket(this.address);
    let steady = null;
    socket.onopen = () => steady = setTimeout(() => this.left = TRIES, STEADY_MS);
    socket.onclose = ({ reason }) => {
      clearTimeout(steady);
      if (this.closed) return;
      if (this.left-- <= 0) return this.ended(reason);
      this.waiting = setTimeout(() => this.dial(), RETRY_MS);
    };
    this.begun(socket);
  }
}
