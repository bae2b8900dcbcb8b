// The table from above: vehicle, plumes, target, traces. Metres in, pixels out.

const COLOURS = { base: "#3377cc", tip: "#cc3333", target: "#2f7d4f", plume: "#e08a1e" };
const ROOM_M = 0.3;

/** Makes a canvas as sharp as its screen; gives its context and its size in CSS pixels. */
export function sharp(canvas) {
  const scale = window.devicePixelRatio || 1;
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  if (canvas.width !== Math.round(width * scale) || canvas.height !== Math.round(height * scale)) {
    canvas.width = Math.round(width * scale);
    canvas.height = Math.round(height * scale);
  }
  const context = canvas.getContext("2d");
  context.setTransform(scale, 0, 0, scale, 0, 0);
  context.clearRect(0, 0, width, height);
  return [context, width, height];
}

/** The smallest box that holds what moves; grows with each frame. */
export class Extent {
  constructor(scene) {
    this.scene = scene;
    this.box = null;
  }

  add(frame) {
    const add = (x, y, room) => {
      const b = (this.box ??= [x, y, x, y]);
      this.box = [Math.min(b[0], x - room), Math.min(b[1], y - room), Math.max(b[2], x + room), Math.max(b[3], y + room)];
    };
    add(frame.base[0], frame.base[1], ROOM_M);
    for (const [x, y] of frame.joints) add(x, y, 0.1);
    if (frame.target) add(frame.target[0], frame.target[1], this.scene.target_radius + 0.1);
  }

  window(whole) {
    const [w, h] = this.scene.table;
    return whole || !this.box ? [-w / 2 - 0.1, -h / 2 - 0.1, w / 2 + 0.1, h / 2 + 0.1] : this.box;
  }
}

/** Draws an instant with the ways that led there. */
export function drawAbove(canvas, scene, extent, frames, index, options) {
  const [c, width, height] = sharp(canvas);
  const [x0, y0, x1, y1] = extent.window(options.whole);
  const scale = Math.min(width / (x1 - x0), height / (y1 - y0));
  const at = (x, y) => [width / 2 + (x - (x0 + x1) / 2) * scale, height / 2 - (y - (y0 + y1) / 2) * scale];
  ground(c, scene, at, scale, width, height);
  const frame = frames[index];
  if (!frame) return;
  traces(c, frames, index, at);
  if (frame.target) disc(c, scene, frame, at, scale);
  plumes(c, scene, frame, at, scale);
  if (frame.believed && options.estimate) outline(c, scene, frame.believed, at, scale);
  vehicle(c, scene, frame, at, scale);
}

function ground(c, scene, at, scale, width, height) {
  c.fillStyle = "#d9d5cc";
  c.fillRect(0, 0, width, height);
  const [w, h] = scene.table;
  const [left, top] = at(-w / 2, h / 2);
  c.fillStyle = "#fbfbfa";
  c.fillRect(left, top, w * scale, h * scale);
  c.strokeStyle = "#e6e6e2";
  c.lineWidth = 1;
  c.beginPath();
  for (let k = -Math.floor(w); k <= w; k++) {
    const [x] = at(k * 0.5, 0);
    if (Math.abs(k * 0.5) < w / 2) { c.moveTo(x, top); c.lineTo(x, top + h * scale); }
  }
  for (let k = -Math.floor(h); k <= h; k++) {
    const [, y] = at(0, k * 0.5);
    if (Math.abs(k * 0.5) < h / 2) { c.moveTo(left, y); c.lineTo(left + w * scale, y); }
  }
  c.stroke();
  c.strokeStyle = "#888";
  c.strokeRect(left, top, w * scale, h * scale);
  // The scale: half a metre, as the grid.
  c.strokeStyle = c.fillStyle = "#444";
  c.lineWidth = 2;
  c.beginPath();
  c.moveTo(14, height - 14);
  c.lineTo(14 + 0.5 * scale, height - 14);
  c.stroke();
  c.font = "12px system-ui, sans-serif";
  c.fillText("0.5 m", 16, height - 20);
}

function traces(c, frames, index, at) {
  const step = Math.max(1, Math.floor(index / 1500));
  const line = (of, colour) => {
    c.beginPath();
    let drawn = false;
    const to = (i) => {
      const point = of(frames[i]);
      if (!point) return;
      const [x, y] = at(point[0], point[1]);
      if (drawn) c.lineTo(x, y);
      else c.moveTo(x, y);
      drawn = true;
    };
    for (let i = 0; i < index; i += step) to(i);
    to(index);
    c.strokeStyle = colour;
    c.lineWidth = 1.5;
    c.stroke();
  };
  line((f) => f.target, COLOURS.target);
  line((f) => f.joints[f.joints.length - 1], COLOURS.tip);
  line((f) => f.base, COLOURS.base);
}

function disc(c, scene, frame, at, scale) {
  const [x, y] = at(frame.target[0], frame.target[1]);
  const radius = scene.target_radius * scale;
  c.beginPath();
  c.arc(x, y, radius, 0, 2 * Math.PI);
  c.fillStyle = "rgba(207, 229, 213, 0.85)";
  c.fill();
  c.strokeStyle = "#245c3a";
  c.lineWidth = frame.held ? 3 : 1.5;
  c.stroke();
  // The handle, on the rim at the body's angle 0.
  const [cos, sin] = [Math.cos(frame.target[2]), -Math.sin(frame.target[2])];
  c.beginPath();
  c.moveTo(x + 0.8 * radius * cos, y + 0.8 * radius * sin);
  c.lineTo(x + radius * cos, y + radius * sin);
  c.lineWidth = 6;
  c.stroke();
  c.beginPath();
  c.moveTo(x, y);
  c.lineTo(x + 0.8 * radius * cos, y + 0.8 * radius * sin);
  c.lineWidth = 1;
  c.stroke();
}

/** In the base's axes: x to the right, y up. */
function inBase(c, [x, y, theta], at, scale, draw) {
  c.save();
  const [px, py] = at(x, y);
  c.translate(px, py);
  c.rotate(-theta);
  c.scale(scale, -scale);
  draw();
  c.restore();
}

function plumes(c, scene, frame, at, scale) {
  inBase(c, frame.base, at, scale, () => {
    scene.thrusters.forEach((thruster, k) => {
      if (!((frame.fired >> k) & 1)) return;
      const [x, y] = thruster.at;
      const [dx, dy] = thruster.push.map((v) => -v);
      const tip = [x + 0.2 * dx, y + 0.2 * dy];
      const gas = c.createLinearGradient(x, y, tip[0], tip[1]);
      gas.addColorStop(0, COLOURS.plume);
      gas.addColorStop(1, "rgba(224, 138, 30, 0)");
      c.fillStyle = gas;
      c.beginPath();
      c.moveTo(x, y);
      c.lineTo(tip[0] - 0.05 * dy, tip[1] + 0.05 * dx);
      c.lineTo(tip[0] + 0.05 * dy, tip[1] - 0.05 * dx);
      c.fill();
    });
  });
}

function outline(c, scene, pose, at, scale) {
  const [w, h] = scene.base;
  inBase(c, pose, at, scale, () => {
    c.setLineDash([5 / scale, 4 / scale]);
    c.strokeStyle = COLOURS.base;
    c.lineWidth = 1.5 / scale;
    c.strokeRect(-w / 2 - 3 / scale, -h / 2 - 3 / scale, w + 6 / scale, h + 6 / scale);
  });
}

function vehicle(c, scene, frame, at, scale) {
  const [w, h] = scene.base;
  inBase(c, frame.base, at, scale, () => {
    c.fillStyle = "#c9ced6";
    c.strokeStyle = "#222";
    c.lineWidth = 1.5 / scale;
    c.fillRect(-w / 2, -h / 2, w, h);
    c.strokeRect(-w / 2, -h / 2, w, h);
    c.fillStyle = "#6c7482";
    for (const { at: [x, y] } of scene.thrusters) c.fillRect(x - 0.012, y - 0.012, 0.024, 0.024);
    c.beginPath(); // where it looks
    c.moveTo(0, 0);
    c.lineTo(0.3 * w, 0);
    c.stroke();
  });
  const points = frame.joints.map(([x, y]) => at(x, y));
  c.strokeStyle = "#222"; // the arm's mount
  c.lineWidth = 1.5;
  c.beginPath();
  c.moveTo(...at(frame.base[0], frame.base[1]));
  c.lineTo(...points[0]);
  c.stroke();
  const link = Math.min(14, Math.max(3, 0.05 * scale));
  c.lineJoin = c.lineCap = "round";
  for (const [colour, size] of [["#222", link], ["#f0f0ee", link - 2.4]]) {
    c.beginPath();
    points.forEach(([x, y], k) => (k ? c.lineTo(x, y) : c.moveTo(x, y)));
    c.strokeStyle = colour;
    c.lineWidth = size;
    c.stroke();
  }
  points.forEach(([x, y], k) => {
    c.beginPath();
    c.arc(x, y, 0.26 * link, 0, 2 * Math.PI);
    c.fillStyle = k + 1 === points.length ? "#c22" : "#222";
    c.fill();
  });
  c.lineJoin = "miter";
  c.lineCap = "butt";
}
