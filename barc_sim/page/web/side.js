// The car from the side on its road, and an overview of the whole road.

import { forcesOf } from './lesson.js';
import {
  circle, colours, fill, font, niceStep, QUANTITIES, reading, stroke,
} from './look.js';

const WHEEL = 0.36; // [m] radius
const ARCH = 0.44;
const SPOKES = 5;
const POST = 10; // [m] along the road
const AHEAD = 0.4; // share of the width behind the car

// In metres from the middle between the axles, x forward, y up: side_car.py's outline.
const REAR = [-2.12, -0.1];
const OUTLINE = [
  [-2.28, -0.1, -2.26, 0.12], [-2.26, 0.5, -2.12, 0.56], [-1.95, 0.62, -1.62, 0.64],
  [-1.05, 1.06, -0.55, 1.08], [0.15, 1.12, 0.55, 0.92], [0.85, 0.76, 1.08, 0.56],
  [1.75, 0.5, 2.08, 0.32], [2.28, 0.2, 2.28, 0.02], [2.28, -0.1, 2.12, -0.1],
];
const WINDOWS = [
  [[-1.38, 0.62], [-0.92, 0.9], [-0.55, 0.97], [-0.3, 0.98], [-0.3, 0.62]],
  [[-0.2, 0.62], [-0.2, 0.98], [0.15, 0.96], [0.48, 0.85], [0.84, 0.62]],
];
const HEADLIGHT = [[2.02, 0.3], [2.17, 0.24], [2.24, 0.14], [2.06, 0.18]];
const TAIL_LIGHT = [[-2.24, 0.24], [-2.22, 0.44], [-2.1, 0.46], [-2.12, 0.24]];
const BODY = '#003F74';
const NEWTON_PER_METRE = 4000; // of an arrow
const MINIMUM_ARROW = 0.08; // [m]
const INK = '#222222';

/** Draw the car, with its forces as arrows, and pale cars where `ghosts` are. */
export function drawSide(surface, road, facts, state, ghosts) {
  const { axles } = facts;
  const context = surface.begin();
  const { width, height } = surface;
  const air = context.createLinearGradient(0, 0, 0, height);
  air.addColorStop(0, colours['air-high']);
  air.addColorStop(1, colours['air-low']);
  context.fillStyle = air;
  context.fillRect(0, 0, width, height);
  if (!state || !road.points.length) return;

  const scale = Math.min(Math.max(width / 28, 14), height / 9);
  const wheelsAt = (position) => axles.map((axle) => {
    const { h } = road.at(position + axle);
    return [h, road.wheel(h, WHEEL)];
  });
  const wheels = wheelsAt(state.x);
  const camera = [(wheels[0][0] + wheels[1][0]) / 2, (wheels[0][1] + wheels[1][1]) / 2];
  const toScreen = ([h, e]) => [
    AHEAD * width + (h - camera[0]) * scale, 0.56 * height - (e - camera[1]) * scale,
  ];
  const left = camera[0] - (AHEAD * width) / scale - 1;
  const right = camera[0] + ((1 - AHEAD) * width) / scale + 1;
  drawGround(context, road, toScreen, left, right, height);
  drawPosts(surface, road, toScreen, state.x, scale);
  for (const ghost of ghosts) {
    context.globalAlpha = 0.3;
    drawCar(context, wheelsAt(ghost.x).map(toScreen), scale, axles, ghost.x);
    context.globalAlpha = 1;
  }
  const placed = wheels.map(toScreen);
  drawCar(context, placed, scale, axles, state.x);
  drawForces(surface, placed, scale, facts, state);
  context.font = font(12);
  ghosts.forEach((ghost, k) => {
    const [[h, e]] = wheelsAt(ghost.x);
    const [x] = toScreen([h, e]);
    if (x > 0 && x < width) write(surface, ghost.name, x, 14 + 16 * k); // above it, where it is seen
  });
}

/** Draw each force from the car along the road; forces of one direction are stacked. */
function drawForces(surface, [rear, front], scale, { mass }, state) {
  const { context } = surface;
  const tips = [];
  const angle = Math.atan2(front[1] - rear[1], front[0] - rear[0]);
  context.save();
  context.translate((rear[0] + front[0]) / 2, (rear[1] + front[1]) / 2);
  context.rotate(angle);
  context.lineWidth = 4;
  context.lineCap = 'butt';
  const rows = { 1: 0, '-1': 0 };
  for (const [name, force] of Object.entries(forcesOf(state, mass))) {
    const metres = force / NEWTON_PER_METRE;
    if (!(Math.abs(metres) >= MINIMUM_ARROW)) continue;
    const side = Math.sign(metres);
    const y = (0.55 - 0.5 * rows[side]) * -scale;
    rows[side] += 1;
    const from = side * 2.4 * scale;
    const to = from + metres * scale;
    const head = Math.min(10, Math.abs(to - from));
    context.strokeStyle = context.fillStyle = colours[QUANTITIES[name]];
    const back = to - side * head;
    stroke(context, [from, y], [to - side * head * 0.8, y]);
    fill(context, [[to, y], [back, y - 0.6 * head], [back, y + 0.6 * head]]);
    tips.push([name, side, context.getTransform().transformPoint(new DOMPoint(to, y))]);
  }
  context.restore();
  context.font = font(12, 600);
  const back = context.getTransform().inverse();
  for (const [name, side, tip] of tips) {
    const { x, y } = back.transformPoint(tip);
    write(surface, name, side > 0 ? x + 5 : x - 5 - context.measureText(name).width, y);
  }
}

/** Write a text from `x` on; at the border of the surface, as near as possible. */
function write({ context, width, height }, text, x, y) {
  const right = width - context.measureText(text).width - 4;
  context.textAlign = 'left';
  context.textBaseline = 'middle';
  context.fillStyle = colours.ink;
  context.fillText(text, Math.max(Math.min(x, right), 4), Math.max(Math.min(y, height - 10), 10));
}

function drawGround(context, road, toScreen, left, right, height) {
  const edge = new Path2D();
  edge.lineTo(...toScreen([left, road.elevation(left)]));
  for (const { h, e } of road.points) if (h > left && h < right) edge.lineTo(...toScreen([h, e]));
  edge.lineTo(...toScreen([right, road.elevation(right)]));
  const earth = new Path2D(edge);
  earth.lineTo(toScreen([right, 0])[0], height + 10);
  earth.lineTo(toScreen([left, 0])[0], height + 10);
  context.fillStyle = colours.earth;
  context.fill(earth);
  context.strokeStyle = colours.surface;
  context.lineWidth = 3;
  context.lineJoin = 'round';
  context.stroke(edge);
}

function drawPosts({ context, width, height }, road, toScreen, distance, scale) {
  const span = width / scale;
  context.font = font(12);
  context.textAlign = 'center';
  context.textBaseline = 'top';
  context.fillStyle = colours.ink;
  context.strokeStyle = colours.surface;
  context.lineWidth = 1.5;
  const first = Math.ceil((distance - span) / POST) * POST;
  for (let s = first; s < distance + span; s += POST) {
    const { h, e } = road.at(s);
    const [x, y] = toScreen([h, e]);
    stroke(context, [x, y], [x, y + 9]);
    const text = `${reading(s, 0)} m`;
    const half = context.measureText(text).width / 2;
    if (x > half && x < width - half && y > -12 && y < height - 26) context.fillText(text, x, y + 12);
  }
}

function drawCar(context, [rear, front], scale, axles, rolled) {
  const angle = Math.atan2(front[1] - rear[1], front[0] - rear[0]);
  const base = Math.hypot(front[0] - rear[0], front[1] - rear[1]) / 3;
  context.save();
  context.translate((rear[0] + front[0]) / 2, (rear[1] + front[1]) / 2);
  context.rotate(angle);
  context.scale(base, -scale);
  for (const x of [-1.5, 1.5]) disc(context, x, 0.1, 0.9 * ARCH, '#3a3a3a');
  context.fillStyle = BODY;
  context.strokeStyle = INK;
  context.lineWidth = 1.2 / scale;
  const body = outline();
  context.fill(body);
  context.stroke(body);
  for (const window of WINDOWS) fill(context, window, '#dcebf4');
  fill(context, HEADLIGHT, '#f0e442');
  fill(context, TAIL_LIGHT, '#d55e00');
  context.restore();
  for (const [x, y] of [rear, front]) drawWheel(context, x, y, scale, rolled);
}

function drawWheel(context, x, y, scale, rolled) {
  context.save();
  context.translate(x, y);
  context.scale(scale, scale);
  context.rotate(rolled / WHEEL);
  disc(context, 0, 0, WHEEL, INK);
  disc(context, 0, 0, 0.68 * WHEEL, '#d5d5d5');
  context.strokeStyle = INK;
  context.lineWidth = 0.055;
  context.beginPath();
  for (let i = 0; i < SPOKES; i += 1) {
    const angle = (2 * Math.PI * i) / SPOKES;
    context.moveTo(0, 0);
    context.lineTo(0.62 * WHEEL * Math.cos(angle), 0.62 * WHEEL * Math.sin(angle));
  }
  context.stroke();
  disc(context, 0, 0, 0.13 * WHEEL, INK);
  context.restore();
}

function outline() {
  const path = new Path2D();
  path.moveTo(...REAR);
  for (const curve of OUTLINE) path.quadraticCurveTo(...curve);
  for (const x of [1.5, -1.5]) {
    path.arc(x, 0, ARCH, (-13 * Math.PI) / 180, (193 * Math.PI) / 180);
  }
  path.closePath();
  return path;
}

function disc(context, x, y, radius, colour) {
  circle(context, x, y, radius);
  context.fillStyle = colour;
  context.fill();
}

/** Draw the whole known road, with exaggerated heights. */
export function drawCourse(surface, road, state) {
  const context = surface.begin();
  const { width, height } = surface;
  if (!state || !road.points.length) return;
  const [from, to] = road.around(state.x).map((end, i) => end + (i ? 5 : -5));
  const bottom = 18;
  const inside = road.points.filter(({ s }) => s > from && s < to);
  const line = [{ s: from, ...road.at(from) }, ...inside, { s: to, ...road.at(to) }];
  const low = Math.min(...line.map(({ e }) => e));
  const high = Math.max(...line.map(({ e }) => e), low + 6);
  const x = (s) => 16 + ((s - from) / (to - from)) * (width - 32);
  const y = (e) => 10 + ((high - e) / (high - low)) * (height - bottom - 18);
  context.beginPath();
  for (const { s, e } of line) context.lineTo(x(s), y(e));
  context.strokeStyle = colours.surface;
  context.lineWidth = 1.5;
  context.lineJoin = 'round';
  context.stroke();
  context.lineTo(x(to), height - bottom);
  context.lineTo(x(from), height - bottom);
  context.fillStyle = colours.earth;
  context.fill();

  context.font = font(12);
  context.fillStyle = colours.muted;
  context.textAlign = 'center';
  context.textBaseline = 'bottom';
  const step = niceStep(to - from, width / 90);
  for (let s = Math.ceil(from / step) * step; s <= to; s += step) {
    context.fillText(`${reading(s, 0)} m`, Math.min(Math.max(x(s), 20), width - 24), height - 2);
  }
  circle(context, x(state.x), y(road.at(state.x).e), 6);
  context.fillStyle = colours.blue;
  context.strokeStyle = colours.panel;
  context.lineWidth = 2;
  context.fill();
  context.stroke();
}
