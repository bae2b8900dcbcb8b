// The table from above: the scene's shapes where a frame has its bodies, and traces. Metres in, pixels out.

const ROOM_M = 0.3;
const GRID_M = 0.5;
const LINE = 1.5;

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
    const farthest = (shapes) => Math.max(0, ...shapes.flatMap((s) => s.corners_m).flat());
    this.box = null;
    this.target = farthest(scene.target);
    this.table = scene.table.corners_m;
  }

  add(frame) {
    const add = (x, y, room) => {
      const b = (this.box ??= [x, y, x, y]);
      this.box = [Math.min(b[0], x - room), Math.min(b[1], y - room), Math.max(b[2], x + room), Math.max(b[3], y + room)];
    };
    add(frame.base[0], frame.base[1], ROOM_M);
    for (const [x, y] of frame.arm) add(x, y, 0.1);
    if (frame.target) add(frame.target[0], frame.target[1], this.target + 0.1);
  }

  window(whole) {
    const [[x0, y0], , [x1, y1]] = this.table;
    return whole || !this.box ? [x0 - 0.1, y0 - 0.1, x1 + 0.1, y1 + 0.1] : this.box;
  }
}

/** Draws an instant with the ways that led there. */
export function drawAbove(canvas, scene, extent, frames, index, options) {
  const [c, width, height] = sharp(canvas);
  const [x0, y0, x1, y1] = extent.window(options.whole);
  const scale = Math.min(width / (x1 - x0), height / (y1 - y0));
  const at = (x, y) => [width / 2 + (x - (x0 + x1) / 2) * scale, height / 2 - (y - (y0 + y1) / 2) * scale];
  /** Shapes of a body at this pose. */
  const body = (shapes, pose, line = LINE) => pose && shapes.forEach((shape) => draw(c, shape, pose, at, line));
  c.fillStyle = scene.colours.beyond;
  c.fillRect(0, 0, width, height);
  body([scene.table], [0, 0, 0], 1);
  grid(c, scene.table.corners_m, at, scale, height);
  const frame = frames[index];
  if (!frame) return;
  traces(c, scene.colours, frames, index, at);
  body(scene.target, frame.target, frame.held ? 2 * LINE : LINE);
  body(scene.plumes.filter((_, k) => (frame.pushing >> k) & 1), frame.base);
  body(scene.base, frame.base);
  frame.arm.forEach((pose, k) => body(scene.links[k] ?? scene.tip, pose));
  body(scene.goal, frame.goal);
  c.setLineDash([5, 4]);
  const around = scene.base[0].corners_m.map(([x, y]) => [1.07 * x, 1.07 * y]);
  if (options.estimate) body([{ corners_m: around, fill: "none", stroke: scene.colours.base }], frame.believed);
  c.setLineDash([]);
}

function draw(c, shape, [x, y, angle], at, line) {
  const [sin, cos] = [Math.sin(angle), Math.cos(angle)];
  c.beginPath();
  for (const [u, v] of shape.corners_m) c.lineTo(...at(x + cos * u - sin * v, y + sin * u + cos * v));
  c.closePath();
  if (shape.fill !== "none") {
    c.fillStyle = shape.fill;
    c.fill();
  }
  if (shape.stroke !== "none") {
    c.strokeStyle = shape.stroke;
    c.lineWidth = line;
    c.stroke();
  }
}

/** Lines half a metre apart, and how long that is. */
function grid(c, [[x0, y0], , [x1, y1]], at, scale, height) {
  c.strokeStyle = "#e6e6e2";
  c.lineWidth = 1;
  c.beginPath();
  const line = (from, to) => { c.moveTo(...at(...from)); c.lineTo(...at(...to)); };
  for (let x = Math.floor(x0 / GRID_M + 1) * GRID_M; x < x1; x += GRID_M) line([x, y0], [x, y1]);
  for (let y = Math.floor(y0 / GRID_M + 1) * GRID_M; y < y1; y += GRID_M) line([x0, y], [x1, y]);
  c.stroke();
  c.strokeStyle = c.fillStyle = "#444";
  c.lineWidth = 2;
  c.beginPath();
  c.moveTo(14, height - 14);
  c.lineTo(14 + GRID_M * scale, height - 14);
  c.stroke();
  c.font = "12px system-ui, sans-serif";
  c.fillText(`${GRID_M} m`, 16, height - 20);
}

function traces(c, colours, frames, index, at) {
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
  line((f) => f.target, colours.target);
  line((f) => f.arm[f.arm.length - 1], colours.tip);
  line((f) => f.base, colours.base);
}
