// The road on the map: horizontal distance and elevation by the distance along its surface.

const MARGIN = 400; // [m] of road at its first and last grade beyond its ends
const LONG = 500; // [m] from which a road is not shown whole
const SPACING = 0.5; // [m] between the points of a road that is recorded while driving

const toRadians = (degrees) => (degrees * Math.PI) / 180;

export class Road {
  /** `facts`: starts [m] and grades [deg] of the stretches; null if unknown. */
  constructor(facts) {
    this.known = facts !== null;
    this.slopes = []; // {from, to, grade} of the stretches that are not level
    this.points = []; // rising: {s, h, e}, distance, horizontal, elevation [m]
    if (!facts) return;
    const { starts, grades_deg: grades } = facts;
    const first = starts[0] - MARGIN;
    this.from = Math.min(starts[0], 0);
    this.to = starts[starts.length - 1] + (starts.length > 1 ? 20 : 200);
    this.#begin(first, 0, 0);
    starts.slice(1).forEach((start, i) => this.#extend(start, grades[i]));
    this.#extend(this.to + MARGIN, grades[grades.length - 1]);
    this.slopes = grades.map((grade, i) => (
      { from: i ? starts[i] : first, to: starts[i + 1] ?? this.to + MARGIN, grade }
    )).filter(({ grade }) => grade);
    const zero = this.at(0);
    const origin = this.at(starts[0]);
    for (const point of this.points) {
      point.h -= zero.h;
      point.e -= origin.e;
    }
  }

  /** Extend an unknown road by a state. */
  learn(state) {
    if (this.known || Number.isNaN(state.x)) return;
    const theta = Number.isNaN(state.theta_deg) ? 0 : state.theta_deg;
    if (!this.points.length) {
      const slope = toRadians(theta);
      const elevation = Number.isNaN(state.elevation) ? 0 : state.elevation;
      this.from = state.x;
      this.#begin(
        state.x - MARGIN,
        state.x - MARGIN * Math.cos(slope),
        elevation - MARGIN * Math.sin(slope),
      );
      this.#extend(state.x, theta);
      this.#extend(state.x + MARGIN, theta);
    }
    const ahead = this.points[this.points.length - 2];
    if (state.x < ahead.s + SPACING) return;
    this.points.pop();
    this.#extend(state.x, theta);
    this.#extend(state.x + MARGIN, theta);
    this.to = state.x;
  }

  /** Return the part to show [m] around `x`: the whole road, or from 200 m behind the car on. */
  around(x) {
    const [from, to] = [Math.min(this.from ?? 0, x), Math.max(this.to ?? 1, x)];
    return to - from > LONG ? [Math.max(from, x - 200), Math.max(x + 50, from + 250)] : [from, to];
  }

  /** Return the horizontal distance and elevation [m] at `s` [m]. */
  at(s) {
    return this.#between('s', s);
  }

  /** Return the elevation [m] at a horizontal distance [m]. */
  elevation(h) {
    return this.#between('h', h).e;
  }

  /** Return the height [m] of the centre of a wheel of `radius` [m] at `h` [m]. */
  wheel(h, radius) {
    let height = -Infinity;
    for (let i = -8; i <= 8; i += 1) {
      const offset = (i / 8) * radius;
      const above = Math.sqrt(radius * radius - offset * offset);
      height = Math.max(height, this.elevation(h + offset) + above);
    }
    return height;
  }

  #begin(s, h, e) {
    this.points = [{ s, h, e }];
  }

  #extend(s, grade) {
    const last = this.points[this.points.length - 1];
    const slope = toRadians(grade);
    this.points.push({
      s,
      h: last.h + (s - last.s) * Math.cos(slope),
      e: last.e + (s - last.s) * Math.sin(slope),
    });
  }

  #between(key, value) {
    const { points } = this;
    let low = 0;
    let high = points.length - 1;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (points[middle][key] <= value) low = middle;
      else high = middle;
    }
    const [a, b] = [points[low], points[high]];
    const share = (value - a[key]) / (b[key] - a[key]);
    return { h: a.h + share * (b.h - a.h), e: a.e + share * (b.e - a.e) };
  }
}
