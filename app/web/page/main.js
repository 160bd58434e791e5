// The page: shows the live head, flat in any browser and in stereo in a headset.
//   cloud.js (worker) -> Splats -> canvas or headset        Microphone -> server
// `?bare` hides the controls and the count of frames, for use as a browser source in other programs.

import { Orbit, place, multiply } from "./camera.js";
import { Controls } from "./controls.js";
import { Headset } from "./xr.js";
import { Microphone } from "./microphone.js";
import { PoseSender } from "./pose.js";
import { Sound } from "./sound.js";
import { Splats } from "./splats.js";
import { Targets } from "./targets.js";

const get = (id) => document.getElementById(id);
const canvas = get("view");
const gl = canvas.getContext("webgl2", { antialias: false, alpha: false, depth: false });
if (!gl) throw Error((get("state").textContent = "This browser has no WebGL2."));
// A phone may take it away while the page is not seen.
canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
canvas.addEventListener("webglcontextrestored", () => location.reload());
const splats = new Splats(gl);
const orbit = new Orbit();
const worker = new Worker("cloud.js");
const sockets = location.href.replace(/^http/, "ws").replace(/[?#].*/, "").replace(/[^/]*$/, "");
// for people with a console, and for tests; `asked` and `sorted` count orders
const stats = { frame: -1, updates: 0, draws: 0, asked: 0, sorted: 0 };
globalThis.livedrive = stats;
let mirror = false;
let offers = null;      // what livedrive has for a page, and how its controls stand
let poses = null;       // where livedrive listens to the headset
let stale = true;       // the canvas must be drawn anew
let fresh = false;      // what the worker sent last was not drawn yet
let asked = [0, 0, 0];  // direction of the last order
let connected = false;  // ticks can come
const COMPLAINT_MS = 8000;  // that something a person tried and that failed is shown
const bare = new URLSearchParams(location.search).has("bare");
document.body.classList.toggle("bare", bare);

// The order is asked for again when the head is seen from a new side.
function aim(modelView) {
  const wanted = [modelView[2], modelView[6], modelView[10]];
  const length = Math.hypot(...wanted) || 1;
  const direction = wanted.map((v) => v / length);
  if (Math.hypot(...direction.map((v, k) => v - asked[k])) < 0.002) return;
  asked = direction;
  worker.postMessage({ direction, asked: ++stats.asked });
}

function drawFlat() {
  requestAnimationFrame(drawFlat);
  if (headset.session) return;
  const { clientWidth, clientHeight } = canvas;
  const width = Math.round(clientWidth * devicePixelRatio);
  const height = Math.round(clientHeight * devicePixelRatio);
  if (canvas.width !== width || canvas.height !== height) {
    Object.assign(canvas, { width, height });
    stale = true;
  }
  if (!stale) return;
  stale = false;
  const modelView = multiply(orbit.view(), place([0, 0, 0], 0, mirror ? -1 : 1, 1));
  aim(modelView);
  gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  gl.viewport(0, 0, width, height);
  gl.clearColor(0.16, 0.16, 0.16, 1);
  gl.clear(gl.COLOR_BUFFER_BIT);
  draw(modelView, orbit.projection(width, height), width, height);
}

function draw(modelView, projection, width, height) {
  splats.draw(modelView, projection, width, height);
  stats.draws++;
  if (fresh) worker.postMessage({ drawn: true });
  fresh = false;
}

const headset = new Headset(gl, {
  draw, aim, isMirror: () => mirror,
  posed: (time, pose) => poses?.send(time, pose),
  ended: () => {
    poses?.stop();
    stale = true;
    get("vr").textContent = "Enter VR";
  },
});

worker.onmessage = ({ data }) => {
  if (data.kind === "state") {
    connected = !data.text;
    return headset.targets ? null : say(data.text);
  }
  if (data.kind === "base") return splats.setBase(data);
  if (data.kind === "tick") return stats.updates = data.updates;
  splats.set(data.words, data.sorted, data.neck);
  stats.frame = data.frame;
  stats.sorted = data.asked;
  stale = fresh = true;
};
worker.postMessage({ address: `${sockets}head` });

const microphone = new Microphone(`${sockets}microphone`, (problem) => {
  get("microphone").setAttribute("aria-pressed", microphone.on);
  get("microphone").textContent = microphone.on ? "Microphone on" : "Use this microphone";
  if (problem) complain(problem);
});
stats.microphone = microphone;

const sound = stats.sound = new Sound(`${sockets}sound`, (problem) => {
  get("sound").setAttribute("aria-pressed", sound.on);
  if (problem) complain(problem);
});

let told = "", complaint = "", since = performance.now(), seen = 0;
function say(text) {
  [told, complaint] = [text, ""];
  get("state").textContent = text;
}
function complain(text) {
  get("state").textContent = complaint = text;
  setTimeout(() => complaint === text && say(told), COMPLAINT_MS);
}
setInterval(() => {
  const now = performance.now(), rate = (stats.updates - seen) * 1000 / (now - since);
  [since, seen] = [now, stats.updates];
  if (!told && !complaint && !bare) {
    get("state").textContent = `frame ${stats.frame}, ${rate.toFixed(0)} a second`;
  }
  if (connected && offers) keepUp();
}, 1000);

get("vr").onclick = async () => {
  try {
    if (headset.session) return await headset.leave();
    await headset.enter();
    poses?.start();
    headset.targets?.start();
    get("vr").textContent = "Leave VR";
  } catch (error) {
    complain(`VR: ${error.message}`);
  }
};
get("mode").onclick = () => {
  mirror = !mirror;
  asked = [0, 0, 0];
  stale = true;
  get("mode").setAttribute("aria-pressed", mirror);
};
get("microphone").onclick = async () => {
  try {
    await (microphone.on ? microphone.stop() : microphone.start());
  } catch (error) {
    complain(`microphone: ${error.message}`);
  }
};
get("sound").onclick = async () => {
  try {
    await (sound.on ? sound.stop() : sound.start());
  } catch (error) {
    complain(`sound: ${error.message}`);
  }
};
get("full").onclick = () =>
  document.fullscreenElement ? document.exitFullscreen() : document.documentElement.requestFullscreen();
let hand = [0, 0];  // where it was; older phones do not tell how far it has moved
canvas.onpointerdown = (event) => {
  canvas.setPointerCapture(event.pointerId);
  hand = [event.clientX, event.clientY];
};
canvas.onpointermove = (event) => {
  if (!canvas.hasPointerCapture(event.pointerId)) return;
  const [x, y] = hand;
  hand = [event.clientX, event.clientY];
  orbit.turn((mirror ? -1 : 1) * (hand[0] - x), hand[1] - y);
  stale = true;
};
canvas.onwheel = (event) => {
  event.preventDefault();
  orbit.scale(Math.exp(-0.001 * event.deltaY));
  stale = true;
};

const controls = new Controls(get, complain);
async function ask() {
  try {
    const answer = await fetch("offers");
    return answer.ok ? await answer.json() : null;
  } catch {
    return null;  // livedrive is not there, which the worker tells
  }
}
// Others change the run, and it may be another one since the page was opened.
async function keepUp() {
  const { answers } = controls, now = await ask();
  if (!now) return;
  if (now.targets !== offers.targets) return location.reload();
  offers = now;
  if (!offers.targets && controls.isUpTo(answers)) controls.show(offers.controls);
  offer();
}
function offer() {
  if (!offers.head) poses?.stop();
  poses = offers.head ? poses ?? new PoseSender(`${sockets}pose`, complain) : null;
  get("sound").hidden = !offers.sound;
  get("microphone").hidden = !offers.microphone || !navigator.mediaDevices;
}

drawFlat();
while (!(offers = await ask())) await new Promise((done) => setTimeout(done, 1000));
if (offers.targets) {
  const buttons = document.querySelector("nav");
  headset.targets = new Targets(
    `${sockets}targets`, get("target"), say, () => { buttons.hidden = false; });
  get("start").hidden = false;
  get("start").onclick = () => {
    buttons.hidden = true;
    headset.targets.start();
  };
  get("mode").hidden = true;
  say("sit 60 cm before the screen, or enter VR");
} else {
  controls.show(offers.controls);
}
offer();
get("vr").hidden = !(await Headset.supported());  // last: who enters at once sends poses
