// A track from above, a small map of it, and the table of its laps.

import {
  circle, colours, make, reading, stroke,
} from './look.js';

const MAP = 160; // [px] the width of the small map, at most
const BEGUN = 1; // [s] after which the present lap is in the table
const MAX_ARCS = 0.9; // If arcs fill a larger share of a lap, as on a racing line, none is shaded.
const STRAIGHT = 1e-9; // [1/m]

export class Track {
  /** `facts`: s, x, y, psi and curvature of points of the centre line; its length and width [m]. */
  constructor(facts) {
    Object.assign(this, facts);
    this.half = facts.width / 2;
    const arcs = []; // {from, to, grade, label}: shaded as slopes are
    facts.curvature.forEach((curvature, i) => {
      const last = arcs[arcs.length - 1];
      const to = facts.s[i + 1] ?? this.length;
      if (Math.abs(curvature) < STRAIGHT) return;
      if (last?.to === facts.s[i] && Math.abs(last.curvature - curvature) < STRAIGHT) last.to = to;
      else arcs.push({ from: facts.s[i], to, curvature, grade: 20 });
    });
    const bent = arcs.reduce((sum, { from, to }) => sum + to - from, 0);
    // A racing line is nearly all arcs.
    this.slopes = bent > MAX_ARCS * this.length ? [] : arcs.map((arc) => ({ ...arc, label: `R ${reading(1 / Math.abs(arc.curvature), 0)} m` }));
  }

  /** A track is known from the start. */
  learn() {}

  /** Return the part to show [m]: the whole lap. */
  around() {
    return [0, this.length];
  }

  /** Return the place of `s` [m] in its lap. */
  place(s) {
    return s - Math.floor(s / this.length) * this.length;
  }

  /** Return the point of the centre line at `s` [m]. */
  at(s) {
    const place = this.place(s);
    let [low, high] = [0, this.s.length - 1];
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (this.s[middle] <= place) low = middle;
      else high = middle;
    }
    const share = (place - this.s[low]) / (this.s[high] - this.s[low] || 1);
    return ['x', 'y'].map((name) => this[name][low] + share * (this[name][high] - this[name][low]));
  }

  #beside(e_y, toScreen) {
    return this.s.map((_, i) => toScreen(
      this.x[i] - e_y * Math.sin(this.psi[i]), this.y[i] + e_y * Math.cos(this.psi[i]),
    ));
  }

  /** Draw the edges, the centre line and the finish line. */
  draw(context, toScreen, width = 2) {
    const [left, right] = [this.half, -this.half].map((e_y) => this.#beside(e_y, toScreen));
    context.beginPath();
    for (const point of [...left, ...right.toReversed()]) context.lineTo(...point);
    context.fillStyle = colours.panel;
    context.fill();
    context.lineJoin = 'round';
    context.lineWidth = width;
    context.strokeStyle = colours.ink;
    stroke(context, ...left);
    stroke(context, ...right);
    context.lineWidth = 2 * width;
    stroke(context, left[0], right[0]);
    context.lineWidth = width / 2;
    context.strokeStyle = colours.muted;
    context.setLineDash([6, 6]);
    stroke(context, ...this.#beside(0, toScreen));
    context.setLineDash([]);
  }

  /** Draw the point that the steering aims at, from the car to it. */
  drawAim(context, toScreen, car, distance) {
    const point = toScreen(...this.at(car.s + distance));
    context.strokeStyle = context.fillStyle = colours.vermillion;
    context.lineWidth = 1.5;
    context.setLineDash([4, 4]);
    stroke(context, toScreen(car.x, car.y), point);
    context.setLineDash([]);
    circle(context, ...point, 6);
    context.fill();
  }

  /** Draw the whole track small, in the upper right corner, with dots where cars are. */
  drawMap({ context, width }, cars) {
    const size = [1, 0.75].map((share) => share * Math.min(MAP, 0.28 * width));
    const [low, high] = [Math.min, Math.max].map((of) => [of(...this.x), of(...this.y)]);
    const scale = Math.min(...[0, 1].map((i) => (size[i] - 16) / (high[i] - low[i] + this.width)));
    const toScreen = (x, y) => [
      width - 8 - size[0] / 2 + (x - (low[0] + high[0]) / 2) * scale,
      8 + size[1] / 2 - (y - (low[1] + high[1]) / 2) * scale,
    ];
    context.fillStyle = colours.ground;
    context.fillRect(width - 8 - size[0], 8, ...size);
    this.draw(context, toScreen, 1);
    for (const [car, alpha] of cars) {
      if (!car) continue;
      context.globalAlpha = alpha;
      circle(context, ...toScreen(car.x, car.y), 5);
      context.fillStyle = colours.blue;
      context.fill();
    }
    context.globalAlpha = 1;
  }
}

/** Return the distance ahead [m] of the point that the steering aims at; 0: none. */
export function aimOf(tuning, speed) {
  const of = (name) => tuning[`lane.${name}`] ?? 0;
  const v = Math.abs(speed);
  return of('look_ahead') + of('look_ahead_time') * v + of('preview') * v;
}

/** Show the laps in the table, the best one in bold, and mark the one with the number `shown`. */
export function showTrackLaps({ table, current, best }, shown) {
  const isNew = current.end - current.start > BEGUN && !table.some(({ number }) => number === current.number);
  const rows = isNew ? [...table, current] : table;
  const text = JSON.stringify([rows, best, shown]);
  const body = document.getElementById('track-laps');
  if (body.dataset.shown === text) return;
  body.dataset.shown = text;
  const cell = (value, digits) => make('td', {}, reading(value, digits));
  body.replaceChildren(...rows.map((lap) => make(
    'tr', {
      className: lap.number === best?.number ? 'best' : '',
      title: lap.gains,
      ariaCurrent: lap.number === shown,
    },
    make('th', { scope: 'row' }, `${lap.number + 1}`),
    cell(lap.time, 2), cell(lap.rms, 3), cell(lap.maximum, 3), cell(100 * lap.at_limit, 1),
  )));
}
