// A line chart over time or position, with ghosts of other laps, shaded slopes and a cursor.

import { colours, ease, font, niceStep, reading, stroke } from './look.js';

const EASE = 0.2; // share of the way to new limits, at each drawing
const [LEFT, RIGHT, TOP, BOTTOM] = [44, 8, 8, 22];
const NAMES = 16; // [px] below the lines, for the names of the slopes
const DENSE = 2; // rows per pixel from which only the extremes are drawn
const SAMPLES = 4096; // rows that the limits are taken from

export class Chart {
  /**
   * `lines`: {column, scale, colour, width, dash, hidden, leads}, the first one at the bottom; the
   * limits follow those that lead. `span`: the minimum difference of the limits; `widest`: the maximum.
   */
  constructor(surface, lines, span, widest) {
    this.surface = surface;
    this.lines = lines;
    this.span = span;
    this.widest = widest;
    this.shown = null;
    this.limit = 0; // of the motor, a line on both sides; 0: none
  }

  /** Return the value on the horizontal axis at a place [px]. */
  value(place, [from, to]) {
    const share = (place - LEFT) / Math.max(this.surface.width - LEFT - RIGHT, 1);
    return from + share * (to - from);
  }

  /**
   * Draw the part of the run that `view` shows: {axis: 't' or 'place', range, first, last, cursor,
   * from, ghosts: [{history, first, last, shift, dash}], slopes: [{from, to, grade}]}. The scale
   * fits this run from the position `from` on; on a track it also fits the ghosts.
   */
  draw(history, state, view) {
    const context = this.surface.begin();
    if (!state) return;
    const { width, height } = this.surface;
    const [from, to] = view.range;
    const goal = this.#limits(history, view);
    this.shown = this.shown?.map((limit, i) => limit + ease(EASE) * (goal[i] - limit)) ?? goal;
    const [low, high] = this.shown;
    const x = (t) => LEFT + ((t - from) / (to - from)) * (width - LEFT - RIGHT);
    const bottom = height - BOTTOM - (view.slopes.length ? NAMES : 0);
    const y = (v) => TOP + ((high - v) / (high - low)) * (bottom - TOP);
    for (const { from: start, to: end, grade, label: name } of view.slopes) {
      context.fillStyle = colours.slope;
      context.globalAlpha = Math.min(0.25 + Math.abs(grade) / 40, 1);
      const [a, b] = [Math.max(x(start), LEFT), Math.min(x(end), width - RIGHT)];
      if (b > a) context.fillRect(a, TOP, b - a, height - TOP - BOTTOM);
      context.globalAlpha = 1;
      const text = name ?? `${reading(grade, 0)}°`;
      context.font = font(12);
      if (b - a > context.measureText(text).width + 4) label(context, text, (a + b) / 2, height - BOTTOM - 4);
    }
    drawAxes(context, width, height, view.axis, { from, to, low, high, x, y });

    context.save();
    context.beginPath();
    context.rect(LEFT, TOP - 2, width - LEFT - RIGHT + 2, bottom - TOP + 4);
    context.clip();
    const lines = this.lines.filter((line) => !line.hidden);
    for (const ghost of view.ghosts) {
      context.globalAlpha = 0.45;
      for (const line of lines) {
        if (line.column === 'reference') continue;
        drawLine(context, ghost.history, ghost, line, view.axis, (v) => x(v + ghost.shift), y, ghost.dash);
      }
      context.globalAlpha = 1;
    }
    for (const line of lines) {
      drawLine(context, history, view, line, view.axis, x, y, line.dash, state);
    }
    for (const level of this.limit ? [this.limit, -this.limit] : []) {
      context.strokeStyle = colours.ink;
      context.lineWidth = 1;
      context.setLineDash([10, 3, 2, 3]);
      stroke(context, [LEFT, y(level)], [width - RIGHT, y(level)]);
      context.setLineDash([]);
      if (level > 0) label(context, 'limit of the motor', width - RIGHT - 58, y(level) - 5);
    }
    if (view.cursor !== null) {
      context.strokeStyle = colours.muted;
      context.lineWidth = 1;
      stroke(context, [x(view.cursor), TOP], [x(view.cursor), height - BOTTOM]);
    }
    context.restore();
  }

  /** Return limits on whole ticks around the visible values. */
  #limits(history, view) {
    let [low, high] = [Infinity, -Infinity];
    const shown = this.lines.filter((line) => !line.hidden);
    const leading = shown.filter((line) => line.leads);
    const lines = leading.length ? leading : shown;
    const { last } = view;
    const behind = history.at(last, 'place') > view.from; // if not, no value would be left
    // Laps of a track are alike: the best one keeps the scale steady.
    for (const part of history.track ? [view, ...view.ghosts] : [view]) {
      const rows = part.history ?? history;
      const stride = Math.max(1, Math.floor((part.last - part.first) / SAMPLES));
      for (let row = part.first; row <= part.last; row += stride) {
        if (behind && rows.at(row, 'place') < view.from) continue;
        for (const { column, scale = 1 } of lines) {
          const value = scale * rows.at(row, column);
          if (value < low) low = value;
          if (value > high) high = value;
        }
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

function label(context, text, x, y) {
  context.font = font(12);
  context.fillStyle = colours.muted;
  context.textAlign = 'center';
  context.textBaseline = 'alphabetic';
  context.fillText(text, x, y);
}

function drawAxes(context, width, height, axis, { from, to, low, high, x, y }) {
  context.font = font(12);
  context.fillStyle = colours.muted;
  context.lineWidth = 1;
  context.textAlign = 'right';
  context.textBaseline = 'middle';
  const step = niceStep(high - low, 4);
  const digits = Math.max(0, Math.ceil(-Math.log10(step) - 1e-9));
  for (let i = Math.ceil(low / step - 0.01); i * step <= high + 0.01 * step; i += 1) {
    const v = Math.round(y(i * step)) + 0.5;
    context.strokeStyle = i === 0 ? colours.muted : colours.grid;
    stroke(context, [LEFT, v], [width - RIGHT, v]);
    context.fillText(reading(i * step, digits), LEFT - 6, v);
  }
  const tick = niceStep(to - from, Math.max(width / 90, 2));
  const places = Math.max(0, Math.ceil(-Math.log10(tick) - 1e-9));
  const unit = axis === 't' ? 's' : 'm';
  for (let t = Math.ceil(from / tick) * tick; t <= to + 1e-9; t += tick) {
    const u = x(t);
    if (u < LEFT || (axis === 't' && t < 0)) continue;
    const text = `${reading(t, places)} ${unit}`;
    label(context, text, Math.min(u, width - context.measureText(text).width / 2), height - 4);
  }
}

function drawLine(context, history, { first, last }, line, axis, x, y, dash, state = null) {
  const width = history.columns.length;
  const { data, index } = history;
  const [at, column, lap] = [index[axis], index[line.column], index.lap];
  if (column === undefined) return;
  const { scale = 1 } = line;
  context.strokeStyle = colours[line.colour];
  context.lineWidth = line.width;
  context.lineJoin = 'round';
  context.setLineDash(dash ?? []);
  context.beginPath();
  let pen = false;
  let before = NaN;
  const span = Math.abs(x(data[last * width + at]) - x(data[first * width + at]));
  const dense = axis === 't' && last - first > DENSE * Math.max(span, 1);
  let [pixel, low, high] = [NaN, Infinity, -Infinity];
  for (let row = first; row <= last; row += 1) {
    const value = scale * data[row * width + column];
    const now = data[row * width + lap];
    if (now !== before) pen = false; // a new lap: no line from the last one
    before = now;
    if (Number.isNaN(value)) {
      pen = false;
      continue;
    }
    const u = x(data[row * width + at]);
    if (dense) { // one stroke per pixel, between the extremes
      if (Math.floor(u) !== pixel || !pen) {
        if (low <= high && pen) {
          context.lineTo(pixel, y(low));
          context.lineTo(pixel, y(high));
        }
        if (!pen) context.moveTo(u, y(value));
        [pixel, low, high] = [Math.floor(u), value, value];
      } else {
        if (value < low) low = value;
        if (value > high) high = value;
      }
    } else if (pen) {
      context.lineTo(u, y(value));
    } else {
      context.moveTo(u, y(value));
    }
    pen = true;
  }
  const until = state && state[axis];
  if (pen && state && last === history.row(state.t)) context.lineTo(x(until), y(scale * state[line.column]));
  context.stroke();
  context.setLineDash([]);
}
