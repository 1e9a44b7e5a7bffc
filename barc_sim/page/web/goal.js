// A goal for a drive by hand: pass the cones of a slalom, then park in the box. No physics.

import { circle, colours, font, reading, show, stroke } from './look.js';

const CONES = [20, 32, 44, 56].map((x, k) => ({ x, y: 0, side: k % 2 ? -1 : 1 })); // [m]
const CONE = 0.25; // [m] radius
const BOX = { x: 80, y: 0, length: 7, width: 3.2 }; // [m] its middle, and its sides
const CAR = { length: 4.5, width: 1.9 }; // [m]
const MOVES = 0.05; // [m/s]
const STANDS = 1; // [s] in the box

/** Return where a point is in the car's frame [m], for a car whose middle is `middle` ahead of x, y. */
function inCar({ x, y, psi }, middle, point) {
  const [dx, dy] = [point.x - x, point.y - y];
  const [cos, sin] = [Math.cos(psi), Math.sin(psi)];
  return [dx * cos + dy * sin - middle, dy * cos - dx * sin];
}

/** Return whether the car touches a cone. */
function touches(state, middle, cone) {
  const [along, across] = inCar(state, middle, cone);
  const [u, v] = [Math.max(Math.abs(along) - CAR.length / 2, 0), Math.max(Math.abs(across) - CAR.width / 2, 0)];
  return Math.hypot(u, v) < CONE;
}

/** Return whether the whole car is in the box. */
function isInBox({ x, y, psi }, middle) {
  const [cos, sin] = [Math.cos(psi), Math.sin(psi)];
  const alongX = (Math.abs(cos) * CAR.length + Math.abs(sin) * CAR.width) / 2;
  const alongY = (Math.abs(sin) * CAR.length + Math.abs(cos) * CAR.width) / 2;
  return Math.abs(x + middle * cos - BOX.x) + alongX <= BOX.length / 2
    && Math.abs(y + middle * sin - BOX.y) + alongY <= BOX.width / 2;
}

export class Goal {
  /** `now` returns the time [s] from which attempts count; `changed` is called after a change. */
  constructor(now, changed) {
    this.on = false;
    this.since = NaN; // [s] when it was switched on
    this.time = '0.0'; // [s] of the attempt
    this.best = null; // {start, end, faults} of an attempt
    this.attempt = null;
    this.panel = document.getElementById('goal-panel');
    this.button = document.getElementById('goal');
    this.note = document.getElementById('goal-note');
    this.button.addEventListener('click', () => {
      this.on = !this.on;
      this.button.setAttribute('aria-pressed', this.on);
      this.panel.hidden = !this.on;
      this.attempt = null;
      this.since = now();
      changed();
    });
  }

  /** Follow the states of the present lap up to `t` [s]; the car's middle is `middle` ahead. */
  update(history, t, middle) {
    if (!this.on || !history.count) return;
    const last = history.row(t);
    const lap = history.at(last, 'lap');
    if (this.since > history.last('t')) this.since = -Infinity; // a new run
    if (!this.attempt || this.attempt.lap !== lap || this.attempt.at > history.at(last, 't')) {
      this.attempt = { lap, at: -Infinity, start: null, end: null, inBox: null, touched: new Set(), missed: new Set() };
    }
    const { at } = this.attempt;
    const first = at < history.at(0, 't') ? history.lapStart(last) : history.row(at) + 1;
    for (let row = first; row <= last; row += 1) {
      if (history.at(row, 't') >= this.since) this.#step(history, row, middle);
    }
    this.#show(history.at(last, 't'));
  }

  /** Return the state of the best attempt, as long after its start as `t` is after this one's. */
  ghost(history, t) {
    const { attempt, best } = this;
    if (!this.on || !best || attempt?.start == null || best.start === attempt.start) return null;
    return history.state(Math.min(best.start + t - attempt.start, best.end));
  }

  #step(history, row, middle) {
    const { attempt } = this;
    const state = Object.fromEntries(['t', 'x', 'y', 'psi', 'absolute_speed'].map((name) => [name, history.at(row, name)]));
    const before = attempt.before ?? state;
    attempt.before = state;
    attempt.at = state.t;
    if (attempt.end !== null) return;
    if (attempt.start === null && state.absolute_speed > MOVES) attempt.start = state.t;
    if (attempt.start === null) return;
    CONES.forEach((cone, k) => {
      if (touches(state, middle, cone)) attempt.touched.add(k);
      const passes = before.x <= cone.x && state.x > cone.x;
      if (passes && (state.y - cone.y) * cone.side <= 0) attempt.missed.add(k);
    });
    const stands = state.absolute_speed < MOVES && isInBox(state, middle);
    attempt.inBox = stands ? attempt.inBox ?? state.t : null;
    if (stands && state.t - attempt.inBox >= STANDS) this.#finish(attempt);
  }

  /** End an attempt; the best has the fewest faults, and then the shortest time. */
  #finish(attempt) {
    attempt.end = attempt.inBox;
    const faults = attempt.touched.size + attempt.missed.size;
    const found = { start: attempt.start, end: attempt.end, faults };
    const { best } = this;
    const time = found.end - found.start;
    if (!best || faults < best.faults || (faults === best.faults && time < best.end - best.start)) {
      this.best = found;
    }
    this.note.textContent = `Parked after ${reading(time, 1)} s, faults: ${faults}. Reset to try again.`;
  }

  #show(now) {
    const { attempt, best } = this;
    const text = (id, value) => show(document.getElementById(id), value);
    if (attempt.end === null) this.note.textContent = 'Pass left of the first cone, right of the next, and so on; then park in the box.';
    this.time = reading(attempt.start === null ? 0 : (attempt.end ?? now) - attempt.start, 1);
    text('goal-time', this.time);
    text('goal-touched', String(attempt.touched.size));
    text('goal-missed', String(attempt.missed.size));
    text('goal-best', best ? `${reading(best.end - best.start, 1)} s, faults: ${best.faults}` : '–');
  }

  /** Draw cones and box on the ground, and the time above. */
  draw({ context, width, height }, scale, toScreen) {
    if (!this.on) return;
    context.font = font(18, 600);
    context.fillStyle = colours.ink;
    context.textAlign = 'center';
    context.textBaseline = 'middle';
    context.fillText(`${this.time} s`, width / 2, 38);
    const here = this.attempt?.before;
    const next = here && (CONES.find((cone) => cone.x > here.x) ?? BOX);
    const [x, y] = next ? toScreen(next.x, next.y) : [0, 0];
    if (next && (x < 0 || x > width || y < 0 || y > height)) { // not visible: its distance, at the border
      const away = `● ${reading(Math.hypot(next.x - here.x, next.y - here.y), 0)} m`;
      context.fillText(away, Math.min(Math.max(x, 40), width - 40), Math.min(Math.max(y, 70), height - 20));
    }
    const [left, top] = toScreen(BOX.x - BOX.length / 2, BOX.y + BOX.width / 2);
    context.lineWidth = 3;
    context.strokeStyle = this.attempt?.end == null ? colours.ink : colours.green;
    context.setLineDash([8, 6]);
    context.strokeRect(left, top, BOX.length * scale, BOX.width * scale);
    context.setLineDash([]);
    CONES.forEach((cone, k) => {
      const [x, y] = toScreen(cone.x, cone.y);
      const touched = this.attempt?.touched.has(k);
      circle(context, x, y, Math.max(CONE * scale, 4));
      context.fillStyle = touched ? colours.muted : colours.vermillion;
      context.fill();
      context.strokeStyle = colours.panel;
      context.lineWidth = 2;
      context.stroke();
      const [u, v] = toScreen(cone.x, cone.y + 2.2 * cone.side); // where to pass
      context.strokeStyle = this.attempt?.missed.has(k) ? colours.vermillion : colours.muted;
      stroke(context, [u - 8, v - 6], [u, v], [u - 8, v + 6]);
    });
  }
}
