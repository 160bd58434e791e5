// A worker: receives the head, and sorts its Gaussians far to near for the view it is told.
// The bytes are described in app/web/cloud.py.

const BASE = 1;
const BUCKETS = 1 << 16;
const FAINTEST = 4;  // of 255: the opacity below which splats.js draws nothing
const RETRY_MS = 1000;

const LIGHT = 33;  // numbers of the lamps and the film
const NECK = 9 * 12;  // numbers of its moves

let base = null;   // Uint32Array [4 N], the head at rest
let words = null;  // Uint32Array [4 N], the head now
let count = 0;
let neck = null;   // Float32Array [9, 3, 4], how the head is turned
let frame = -1;
let updates = 0;
let direction = [0, 0, 1];  // growing from far to near, in units of the position's steps
let asked = 0;          // number of the last order asked for
let moved = false;      // a tick has come since the last order
let turned = false;     // the view has changed since then
let free = true;        // the page has drawn the last order
let scheduled = false;

function readBase(view, buffer) {
  count = view.getUint32(4, true);
  const ranges = new Float32Array(buffer.slice(8, 44));
  base = new Uint32Array(buffer.slice(44, 44 + 16 * count));
  words = base.slice();
  const end = 44 + 16 * count, mirrors = view.getUint32(end, true), bytes = end + 4 + 4 * LIGHT;
  const light = new Float32Array(buffer.slice(end + 4, bytes));
  const weights = new Uint8Array(buffer.slice(bytes, bytes + 4 * mirrors));
  const roughness = new Uint8Array(buffer.slice(bytes + 4 * mirrors, bytes + 5 * mirrors));
  postMessage({ kind: "base", count, ranges, mirrors, light, weights, roughness });
}

function readTick(view, buffer) {
  frame = Number(view.getBigInt64(8, true));
  const bits = 32 + view.getUint32(28, true);  // where the bits start, after the neck if there is one
  neck = bits > 32 ? new Float32Array(buffer.slice(32, bits)) : null;
  const moved = new Uint32Array(buffer, bits + 4 * Math.ceil(count / 32));
  const flags = new Uint32Array(buffer, bits, Math.ceil(count / 32));
  words.set(base);
  for (let block = 0, from = 0; block < flags.length; block++) {
    for (let rest = flags[block]; rest !== 0; rest &= rest - 1) {
      const at = 4 * (32 * block + 31 - Math.clz32(rest & -rest));
      words[at] = moved[from++];
      words[at + 1] = moved[from++];
      words[at + 2] = moved[from++];
      words[at + 3] = moved[from++];
    }
  }
  updates++;
}

// Counting sort by depth in 65536 steps over the head's own depth: 5 micrometres each. Gaussians
// too faint to be drawn are left out.
function order() {
  const depths = new Float32Array(count), shown = new Uint32Array(count);
  const [a, b, c] = seenFromTheHead(direction);
  let low = Infinity, high = -Infinity, num = 0;
  for (let i = 0; i < count; i++) {
    if (words[4 * i + 3] >>> 24 < FAINTEST) continue;
    const one = words[4 * i], two = words[4 * i + 1];
    const depth = a * (one & 16383) + b * (one >>> 14 & 16383) + c * (two & 16383);
    depths[num] = depth;
    shown[num++] = i;
    if (depth < low) low = depth;
    if (depth > high) high = depth;
  }
  const scale = (BUCKETS - 1) / Math.max(high - low, 1e-6);
  const keys = new Uint16Array(num);
  const starts = new Uint32Array(BUCKETS + 1);
  for (let k = 0; k < num; k++) {
    keys[k] = (depths[k] - low) * scale;
    starts[keys[k] + 1]++;
  }
  for (let k = 0; k < BUCKETS; k++) starts[k + 1] += starts[k];
  const sorted = new Uint32Array(num);
  for (let k = 0; k < num; k++) sorted[starts[keys[k]]++] = shown[k];
  return sorted;
}

// Most Gaussians go with the head, so their order is that of the head at rest, seen from elsewhere.
function seenFromTheHead([x, y, z]) {
  if (!neck) return [x, y, z];
  const m = neck.subarray(NECK - 12);
  return [0, 1, 2].map((k) => m[k] * x + m[4 + k] * y + m[8 + k] * z);
}

// The newest tick is sorted once the page has drawn the last one: a slow page skips ticks.
function schedule() {
  if (scheduled || !free || !words || !(moved || turned)) return;
  scheduled = true;
  setTimeout(() => {
    const sorted = order(), copy = moved ? words.slice() : null;
    const send = [sorted.buffer];
    if (copy) send.push(copy.buffer);
    postMessage({ kind: "sorted", frame, asked, sorted, words: copy, neck }, send);
    scheduled = free = moved = turned = false;
  });
}

async function wait(address) {
  try {
    const answer = await fetch(address.replace(/^ws/, "http"));  // of a socket the reason is not told
    const refused = [403, 503].includes(answer.status);  // without a token; too many pages
    postMessage({ kind: "state", text: refused ? await answer.text() : "waiting for livedrive" });
  } catch {
    postMessage({ kind: "state", text: "waiting for livedrive" });
  }
  setTimeout(() => connect(address), RETRY_MS);
}

function connect(address) {
  const socket = new WebSocket(address);
  socket.binaryType = "arraybuffer";
  socket.onopen = () => postMessage({ kind: "state", text: "" });
  socket.onmessage = ({ data }) => {
    const view = new DataView(data);
    if (view.getUint8(0) === BASE) readBase(view, data);
    else if (base && view.getUint32(4, true) === count) readTick(view, data);
    else return;
    postMessage({ kind: "tick", updates });
    moved = true;
    schedule();
  };
  socket.onclose = () => wait(address);
}

onmessage = ({ data }) => {
  if (data.address) return connect(data.address);
  if (data.drawn) free = true;
  if (data.direction) [direction, asked, turned] = [data.direction, data.asked, true];
  schedule();
};
