// Values over time: phases, lines, valves, with events as marks and the time in hand as a line.

import { sharp } from "./above.js";

const COLOURS = ["#2b6ca3", "#b3402a", "#2f7d4f", "#b8860b", "#6b4c9a", "#177e89", "#8a5a44", "#555555"];
const [LEFT, RIGHT, TITLE] = [52, 8, 15];
const DEGREES = 180 / Math.PI;

/** What is shown of a frame: title, names of the lines, their values, least range. */
function charts(scene, frames) {
  const joints = scene.links.map((_, k) => `${k + 1}`);
  const has = (key) => frames.some((f) => f[key] !== undefined);
  const all = [
    ["base heading, deg", [""], (f) => [f.base[2] * DEGREES], 0.5],
    ["base velocity, mm/s", ["vx", "vy"], (f) => [f.rate[0] * 1e3, f.rate[1] * 1e3], 2],
    ["base rate, deg/s", [""], (f) => [f.rate[2] * DEGREES], 0.2],
    ["joint angles, deg", joints, (f) => f.q.map((q) => q * DEGREES), 2],
    ["joint torques, N m", joints, (f) => f.torque, 0.1],
  ];
  if (has("error")) all.push(["navigation error, mm", ["x", "y"], (f) => (f.error ? [f.error[0] * 1e3, f.error[1] * 1e3] : []), 0.2]);
  if (has("gas")) all.push(["gas used, g", [""], (f) => [f.gas * 1e3], 0.1]);
  return all.map(([title, names, values, least]) => ({ title, names, values, least }));
}

/** Draws `frames` over `[from, to]` s with a line at `now`; gives the time at a place on the canvas. */
export function drawStrips(canvas, scene, frames, events, [from, to], now, index) {
  const [c, width, height] = sharp(canvas);
  const x = (t) => LEFT + ((width - LEFT - RIGHT) * (t - from)) / (to - from || 1);
  const shown = frames.filter((f) => f.t >= from && f.t <= to);
  const rows = charts(scene, shown);
  const [band, row, axis] = [16, 8, 16];
  const raster = row * scene.plumes.length;
  const lines = Math.max(24, (height - axis - 2 * TITLE - band - raster - 12) / rows.length - TITLE);
  c.font = "11px system-ui, sans-serif";
  let top = 0;
  top = phases(c, shown, x, top, band, width);
  top = marks(c, events, x, top, from, to);
  for (const chart of rows) top = plot(c, chart, shown, frames[index], x, top, lines, width);
  top = valves(c, scene, shown, x, top, row, width);
  timeAxis(c, from, to, x, top);
  if (now >= from && now <= to) {
    c.strokeStyle = "rgba(34, 34, 34, 0.45)";
    c.lineWidth = 1.5;
    c.beginPath();
    c.moveTo(x(now), 0);
    c.lineTo(x(now), top);
    c.stroke();
  }
  return (px) => from + ((px - LEFT) / (width - LEFT - RIGHT)) * (to - from);
}

function phases(c, frames, x, top, height, width) {
  let begin = 0;
  let count = 0;
  for (let i = 1; i <= frames.length; i++) {
    if (i < frames.length && frames[i].phase === frames[begin].phase) continue;
    const [a, b] = [x(frames[begin].t), i < frames.length ? x(frames[i].t) : x(frames[i - 1].t)];
    c.fillStyle = ["#d6e4f0", "#efe3cf"][count++ % 2];
    c.fillRect(a, top, b - a, height);
    const name = frames[begin].phase;
    c.fillStyle = "#222";
    c.textAlign = "center";
    if (c.measureText(name).width + 6 < b - a) c.fillText(name, (a + b) / 2, top + 12);
    begin = i;
  }
  c.textAlign = "left";
  return top + height;
}

function marks(c, events, x, top, from, to) {
  for (const event of events) {
    if (event.t < from || event.t > to) continue;
    c.fillStyle = event.severity >= 3 ? "#b3402a" : event.severity === 2 ? "#d98b00" : "#9a9a96";
    c.beginPath();
    c.moveTo(x(event.t), top + 1);
    c.lineTo(x(event.t) + 4, top + 9);
    c.lineTo(x(event.t) - 4, top + 9);
    c.fill();
  }
  return top + 12;
}

function frameOf(c, title, top, height, width) {
  c.fillStyle = "#fcfcfb";
  c.fillRect(LEFT, top + TITLE, width - LEFT - RIGHT, height);
  c.strokeStyle = "#c8c8c3";
  c.lineWidth = 1;
  c.strokeRect(LEFT, top + TITLE, width - LEFT - RIGHT, height);
  c.fillStyle = "#222";
  c.textAlign = "left";
  c.fillText(title, LEFT, top + TITLE - 4);
}

function plot(c, chart, frames, current, x, top, height, width) {
  frameOf(c, chart.title, top, height, width);
  const values = frames.map(chart.values);
  let [low, high] = [Infinity, -Infinity];
  for (const row of values) for (const v of row) { if (v < low) low = v; if (v > high) high = v; }
  if (low > high) return top + TITLE + height;
  const half = Math.max(0.54 * (high - low), 0.5 * chart.least);
  [low, high] = [(low + high) / 2 - half, (low + high) / 2 + half];
  const y = (v) => top + TITLE + (height * (high - v)) / (high - low);
  c.textAlign = "right";
  const few = ticks(low, high, Math.max(2, Math.floor(height / 18)));
  for (const [value, label] of few.length > 1 ? few : ticks(low, high, 5)) {
    c.strokeStyle = value === 0 ? "#aaa" : "#ececea";
    c.beginPath();
    c.moveTo(LEFT, y(value));
    c.lineTo(width - RIGHT, y(value));
    c.stroke();
    c.fillStyle = "#666";
    c.fillText(label, LEFT - 4, y(value) + 4);
  }
  const step = Math.max(1, Math.floor(frames.length / 2000));
  chart.names.forEach((_, k) => {
    c.strokeStyle = COLOURS[k % COLOURS.length];
    c.lineWidth = 1.2;
    c.beginPath();
    for (let i = 0, pen = false; i < frames.length; i += step) {
      const v = values[i][k];
      if (v === undefined) { pen = false; continue; }
      if (pen) c.lineTo(x(frames[i].t), y(v));
      else c.moveTo(x(frames[i].t), y(v));
      pen = true;
    }
    c.stroke();
  });
  // Names with the values in hand, from the right.
  let right = width - RIGHT;
  const inHand = current ? chart.values(current) : [];
  for (let k = chart.names.length - 1; k >= 0; k--) {
    const value = inHand[k] === undefined ? "" : inHand[k].toFixed(high - low < 1 ? 3 : 2);
    const words = `${chart.names[k]} ${value}`;
    c.fillStyle = COLOURS[k % COLOURS.length];
    c.fillText(words, right, top + TITLE - 4);
    right -= c.measureText(words).width + 12;
  }
  return top + TITLE + height;
}

function valves(c, scene, frames, x, top, row, width) {
  frameOf(c, "valves", top, row * scene.plumes.length, width);
  c.textAlign = "right";
  scene.plumes.forEach((_, k) => {
    const y = top + TITLE + row * k;
    c.fillStyle = "#666";
    c.font = "9px system-ui, sans-serif";
    c.fillText(`${k + 1}`, LEFT - 4, y + row - 1);
    c.fillStyle = COLOURS[k % 2];
    for (let i = 1; i < frames.length; i++) {
      if ((frames[i].pushing >> k) & 1) c.fillRect(x(frames[i - 1].t), y + 1, Math.max(1, x(frames[i].t) - x(frames[i - 1].t)), row - 2);
    }
  });
  c.font = "11px system-ui, sans-serif";
  return top + TITLE + row * scene.plumes.length;
}

function timeAxis(c, from, to, x, top) {
  c.fillStyle = "#666";
  c.textAlign = "center";
  for (const [t, label] of ticks(from, to, 8)) c.fillText(`${label} s`, x(t), top + 13);
}

/** Round values within a range, and how they are written. */
export function ticks(low, high, most) {
  const rough = (high - low) / most;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((k) => k * power).find((s) => s >= rough) || power;
  const decimals = Math.max(0, -Math.floor(Math.log10(step * 1.0001)));
  const all = [];
  for (let k = Math.ceil(low / step); k * step <= high; k++) all.push([k * step, (k * step).toFixed(decimals)]);
  return all;
}
