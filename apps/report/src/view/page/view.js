// The page: a log with play, pause and scrub, or a running stack as it flies.

import { Extent, drawAbove } from "./above.js";
import { drawStrips } from "./strips.js";

const LIVE_SPAN_S = 60;
const SILENT_MS = 2000;
const MOST_LIVE = 20000;
const byId = (id) => document.getElementById(id);
const make = (tag, text) => Object.assign(document.createElement(tag), { textContent: text });
const fail = (message) => {
  byId("mode").textContent = message;
  byId("mode").className = "pill bad";
  document.body.dataset.error = message;
};
window.addEventListener("error", (e) => fail(e.message));
window.addEventListener("unhandledrejection", (e) => fail(String(e.reason)));

const json = async (path) => {
  const answer = await fetch(path);
  if (!answer.ok) throw new Error(`${path}: ${answer.status}`);
  return answer.json();
};

const scene = await json("/scene.json");
const flight = { frames: [], health: [], events: [], others: [] };
const extent = new Extent(scene);
const state = { now: 0, playing: false, follows: scene.live, heard: 0, timeAt: () => 0, stripsDue: true };

byId("title").textContent = scene.title;
byId("title").title = scene.description;
document.title = `${scene.title} - fss view`;
byId("target-key").hidden = scene.target.length === 0;
for (const [name, colour] of Object.entries(scene.colours)) document.documentElement.style.setProperty(`--${name}`, colour);

/** Index of the last frame at or before a time. */
function indexAt(time) {
  let [low, high] = [0, flight.frames.length];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (flight.frames[middle].t <= time) low = middle + 1;
    else high = middle;
  }
  return Math.max(0, low - 1);
}

const span = () => {
  const frames = flight.frames;
  const [first, last] = [frames[0]?.t ?? 0, frames[frames.length - 1]?.t ?? 1];
  return scene.live ? [Math.max(first, last - LIVE_SPAN_S), Math.max(last, first + 10)] : [first, last];
};

function seek(time) {
  const [from, to] = span();
  state.now = Math.min(to, Math.max(from, time));
  state.follows = scene.live && state.now >= to - 0.5;
  state.stripsDue = true;
}

function show() {
  const { frames, events } = flight;
  const [from, to] = span();
  if (state.follows) state.now = frames[frames.length - 1]?.t ?? 0;
  const index = indexAt(state.now);
  const frame = frames[index];
  const options = { whole: byId("whole").checked, estimate: byId("estimate").checked };
  drawAbove(byId("above"), scene, extent, frames, index, options);
  if (state.stripsDue) {
    state.timeAt = drawStrips(byId("strips"), scene, frames, events, [from, to], state.now, index);
    state.stripsDue = false;
  }
  byId("scrub").min = from;
  byId("scrub").max = to;
  byId("scrub").value = state.now;
  byId("time").textContent = `${state.now.toFixed(2)} of ${to.toFixed(1)} s`;
  byId("play").textContent = scene.live ? (state.follows ? "pause" : "live") : state.playing ? "pause" : "play";
  if (!frame) return;
  byId("phase").textContent = frame.phase;
  const [x, y, theta] = frame.base;
  const words = [`${x.toFixed(3)}, ${y.toFixed(3)} m`, `${((theta * 180) / Math.PI).toFixed(2)} deg`, `navigation ${frame.nav}`];
  if (frame.target) words.push(frame.held ? "target held" : "target free");
  if (frame.gas !== undefined) words.push(`${(frame.gas * 1e3).toFixed(2)} g of gas`);
  byId("facts").textContent = words.join(" \u00b7 ");
}

function tables() {
  const latest = new Map();
  for (const row of flight.health) if (row.t <= state.now + 0.01 || state.follows) latest.set(row.service, row);
  const head = document.createElement("tr");
  for (const name of ["service", "Hz", "cycles", "overruns", "skipped", "wake p99 µs", "step p99 µs", "starts"]) head.append(make("th", name));
  const rows = [...latest.values()].map((h) => {
    const tr = document.createElement("tr");
    const cells = [h.service, h.hz.toFixed(0), h.cycles, h.overruns, h.skipped, h.wake_us[1].toFixed(0), h.step_us[1].toFixed(0), h.starts];
    for (const cell of cells) tr.append(make("td", cell));
    if (state.now - h.t > 1.5) tr.className = "bad";
    tr.title = h.real_time ? "real-time scheduling" : "normal scheduling";
    return tr;
  });
  const none = make("tr", scene.live ? "none heard yet" : "none reported: on a virtual clock no service can be late");
  byId("health").replaceChildren(...(rows.length ? [head, ...rows] : [none]));
  const newest = new Map();
  for (const row of flight.others) if (row.t <= state.now + 0.01 || state.follows) newest.set(row.topic, row);
  byId("others-section").hidden = newest.size === 0;
  byId("others").replaceChildren(...[...newest.values()].map((other) => {
    const tr = document.createElement("tr");
    for (const cell of [other.topic, other.text]) tr.append(make("td", cell));
    if (state.now - other.t > 1.5) tr.className = "bad";
    return tr;
  }));
  const events = flight.events.slice(-200).map((e) => {
    const tr = document.createElement("tr");
    for (const cell of [`${e.t.toFixed(2)} s`, e.service, e.text]) tr.append(make("td", cell));
    tr.className = e.t > state.now ? "future" : e.severity >= 3 ? "bad" : e.severity === 2 ? "warning" : "";
    tr.addEventListener("click", () => seek(e.t));
    return tr;
  });
  byId("events").replaceChildren(...(scene.live ? events.reverse().slice(0, 30) : events));
}

function controls() {
  const toggle = () => {
    if (scene.live) {
      state.follows = !state.follows;
    } else {
      const [from, to] = span();
      state.playing = !state.playing;
      if (state.playing && state.now >= to) state.now = from;
    }
    state.stripsDue = true;
  };
  byId("play").addEventListener("click", toggle);
  byId("scrub").addEventListener("input", (e) => { state.playing = false; seek(Number(e.target.value)); });
  const drag = (e) => { if (e.buttons) { state.playing = false; seek(state.timeAt(e.offsetX)); } };
  byId("strips").addEventListener("pointerdown", drag);
  byId("strips").addEventListener("pointermove", drag);
  window.addEventListener("resize", () => (state.stripsDue = true));
  window.addEventListener("keydown", (e) => {
    if (e.target.tagName === "SELECT") return;
    const steps = { ArrowLeft: -1, ArrowRight: 1, ",": -1 / 30, ".": 1 / 30 };
    if (e.key === " ") { e.preventDefault(); toggle(); }
    else if (e.key in steps && e.target.id !== "scrub") { state.playing = false; seek(state.now + steps[e.key]); }
  });
}

function listen() {
  const stream = new EventSource("/live");
  const heard = () => (state.heard = performance.now());
  stream.addEventListener("frame", (e) => {
    const frame = JSON.parse(e.data);
    const last = flight.frames[flight.frames.length - 1];
    if (last && frame.t <= last.t) return; // said before: the stream began anew
    flight.frames.push(frame);
    if (flight.frames.length > MOST_LIVE) flight.frames.shift();
    extent.add(frame);
    heard();
  });
  const keep = (list, same) => (e) => {
    const row = JSON.parse(e.data);
    if (!list.some((old) => same(old, row))) list.push(row);
    if (list.length > 500) list.shift();
  };
  stream.addEventListener("health", keep(flight.health, (a, b) => a.t === b.t && a.service === b.service));
  stream.addEventListener("other", keep(flight.others, (a, b) => a.t === b.t && a.topic === b.topic));
  stream.addEventListener("event", keep(flight.events, (a, b) => a.t === b.t && a.text === b.text));
}

let [before, stripsAt, tablesAt] = [performance.now(), -Infinity, -Infinity];
function turn(now) {
  const passed = (now - before) / 1000;
  before = now;
  if (state.playing) {
    const [, to] = span();
    seek(state.now + passed * Number(byId("speed").value));
    if (state.now >= to) state.playing = false;
  }
  if (scene.live) {
    const silent = now - state.heard > SILENT_MS;
    byId("mode").textContent = silent ? "no news from the stack" : "live";
    byId("mode").className = silent ? "pill bad" : "pill quiet";
    if (now - stripsAt > 100) [stripsAt, state.stripsDue] = [now, true];
  }
  show();
  if (now - tablesAt > 250) {
    tablesAt = now;
    tables();
  }
  document.body.dataset.frames = flight.frames.length;
  requestAnimationFrame(turn);
}

controls();
if (scene.live) {
  byId("speed").hidden = true;
  listen();
} else {
  Object.assign(flight, await json("/flight.json"));
  flight.frames.forEach((frame) => extent.add(frame));
  byId("mode").textContent = "log";
  // A link may name an instant: #t=83.2
  const asked = /^#t=([0-9.]+)$/.exec(location.hash);
  seek(asked ? Number(asked[1]) : 0);
}
requestAnimationFrame(turn);
