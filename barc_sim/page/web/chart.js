// A line chart over the last seconds.

import { colours, font, niceStep, reading } from './look.js';

const WINDOW = 20; // [s]
const EASE = 0.2; // share of the way to new limits, at each drawing
const [LEFT, RIGHT, TOP, BOTTOM] = [36, 8, 8, 22];

export class Chart {
  /**
   * `lines`: {column, colour, width, dash}, the first one at the bottom; `span`: the least
   * difference of the limits; `widest`: the widest limits.
   */
  constructor(surface, lines, span, widest) {
    this.surface = surface;
    this.lines = lines;
    this.span = span;
    this.widest = widest;
    this.shown = null;
  }

  draw(history, state, window = WINDOW) {
    const context = this.surface.begin();
    if (!state) return;
    const { width, height } = this.surface;
    const to = Math.max(state.t, (history.count ? history.at(0, 't') : 0) + window);
    const from = to - window;
    const rows = [Math.max(history.row(from), 0), history.row(state.t)];
    const goal = this.#limits(history, rows);
    this.shown = this.shown?.map((limit, i) => limit + EASE * (goal[i] - limit)) ?? goal;
    const [low, high] = this.shown;
    const x = (t) => LEFT + ((t - from) / window) * (width - LEFT - RIGHT);
    const y = (v) => TOP + ((high - v) / (high - low)) * (height - TOP - BOTTOM);
    drawAxes(context, width, height, { from, to, low, high, x, y });

    context.save();
    context.beginPath();
    context.rect(LEFT, TOP - 2, width - LEFT - RIGHT + 2, height - TOP - BOTTOM + 4);
    context.clip();
    for (const line of this.lines) drawLine(context, history, rows, state, line, x, y);
    context.restore();
  }

  /** Return limits on whole ticks around the visible values. */
  #limits(history, [first, last]) {
    let [low, high] = [Infinity, -Infinity];
    const stride = Math.max(1, (last - first) >> 10);
    for (let row = first; row <= last; row += stride) {
      for (const { column } of this.lines) {
        const value = history.at(row, column);
        if (value < low) low = value;
        if (value > high) high = value;
      }
    }
    if (low > high) [low, high] = [0, 0];
    const missing = Math.max(this.span - (high - low), 0) / 2;
    low = Math.max(low - missing, this.widest[0]);
    high = Math.min(high + missing, this.widest[1]);
    const step = niceStep(high - low, 4);
    return [Math.floor(low / step + 0.02) * step, Math.ceil(high / step - 0.02) * step];
  }
}

function drawAxes(context, width, height, { from, to, low, high, x, y }) {
  context.font = font(12);
  context.fillStyle = colours.muted;
  context.lineWidth = 1;
  context.textAlign = 'right';
  context.textBaseline = 'middle';
  const step = niceStep(high - low, 4);
  for (let i = Math.ceil(low / step - 0.01); i * step <= high + 0.01 * step; i += 1) {
    const v = Math.round(y(i * step)) + 0.5;
    context.strokeStyle = i === 0 ? colours.muted : colours.grid;
    context.beginPath();
    context.moveTo(LEFT, v);
    context.lineTo(width - RIGHT, v);
    context.stroke();
    context.fillText(reading(i * step, step < 1 ? 1 : 0), LEFT - 6, v);
  }
  context.textAlign = 'center';
  context.textBaseline = 'alphabetic';
  const tick = niceStep(to - from, Math.max(width / 90, 2));
  for (let t = Math.ceil(from / tick) * tick; t <= to + 1e-9; t += tick) {
    const u = x(t);
    if (u < LEFT || t < 0) continue;
    context.fillText(`${reading(t, 0)} s`, Math.min(u, width - 16), height - 4);
  }
}

function drawLine(context, history, [first, last], state, line, x, y) {
  context.strokeStyle = colours[line.colour];
  context.lineWidth = line.width;
  context.lineJoin = 'round';
  context.setLineDash(line.dash ?? []);
  context.beginPath();
  let pen = false;
  for (let row = first; row <= last; row += 1) {
    const value = history.at(row, line.column);
    if (Number.isNaN(value)) {
      pen = false;
      continue;
    }
    const u = x(history.at(row, 't'));
    if (pen) context.lineTo(u, y(value));
    else context.moveTo(u, y(value));
    pen = true;
  }
  if (pen) context.lineTo(x(state.t), y(state[line.column]));
  context.stroke();
  context.setLineDash([]);
}
