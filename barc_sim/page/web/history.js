// The states so far, and the state at any time between them.

const MAX_STATES = 1 << 18; // rows: an hour and a half, then the older half is thinned out

const NEAR = 2; // [m] If a lap begins this near to the end of the one before, the car drove on.
const DERIVED = 2; // columns that are computed here

export class History {
  constructor(maximum = MAX_STATES) {
    this.maximum = maximum;
    this.columns = [];
    this.repeats = false;
    this.mass = 2000; // [kg] of the car
    this.track = null; // the track, where there is one
    this.clear();
  }

  clear() {
    this.count = 0;
    this.data = new Float64Array(1 << 14);
  }

  /** Set the names of a row's values; keep the rows if the run `continues`. */
  name(columns, continues) {
    if (continues && columns.join() === this.columns.slice(0, -DERIVED).join()) {
      this.repeats = true;
      return;
    }
    this.columns = [...columns, 'acting', 'place'];
    this.index = Object.fromEntries(this.columns.map((name, i) => [name, i]));
    this.clear();
  }

  /** Add rows; a time that goes back clears the history. */
  add(rows) {
    const width = this.columns.length;
    const sent = width - DERIVED;
    for (let from = 0; from + sent <= rows.length; from += sent) {
      const t = rows[from];
      if (this.count && t < this.last('t')) {
        if (this.repeats) continue; // the connection was lost, and the last minute is sent again
        this.clear();
      }
      if (this.count && t === this.last('t')) continue;
      if (this.count === this.maximum) this.#thin();
      if ((this.count + 1) * width > this.data.length) this.#grow();
      this.data.set(rows.subarray(from, from + sent), this.count * width);
      this.count += 1;
      this.#derive(this.count - 1);
      this.#place(this.count - 1);
    }
    this.repeats = false;
  }

  at(row, name) {
    return this.data[row * this.columns.length + this.index[name]];
  }

  last(name) {
    return this.count ? this.at(this.count - 1, name) : NaN;
  }

  /** Return the last row at or before `t`; the first if there is none. */
  row(t) {
    let low = 0;
    let high = this.count;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (this.at(middle, 't') <= t) low = middle;
      else high = middle;
    }
    return low;
  }

  /** Return whether a lap begins between `row` and the next one: the car is somewhere else. */
  jumps(row) {
    return this.at(row + 1, 'lap') !== this.at(row, 'lap');
  }

  /** Return whether the car is where it was at `row` when the next lap begins: at a finish line. */
  goesOn(row) {
    const moved = (name) => this.at(row + 1, name) - this.at(row, name);
    return Math.hypot(moved('x'), moved('y')) < NEAR;
  }

  /** Return the first row of the lap of `row`. */
  lapStart(row) {
    const lap = this.at(row, 'lap');
    let low = -1;
    let high = row;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (this.at(middle, 'lap') < lap) low = middle;
      else high = middle;
    }
    return high;
  }

  /** Return the state at `t`: motion is interpolated, commands hold until the next. */
  state(t) {
    if (!this.count) return null;
    const row = this.row(t);
    const state = {};
    for (const name of this.columns) state[name] = this.at(row, name);
    // At the finish line the car's position is continuous, but its place in the lap is not.
    const jumps = row + 1 < this.count && this.jumps(row);
    if (row + 1 < this.count && (!jumps || this.goesOn(row))) {
      const span = this.at(row + 1, 't') - state.t;
      const share = Math.min(Math.max((t - state.t) / span, 0), 1);
      for (const name of jumps ? MOVING.filter((each) => each !== 'place') : MOVING) {
        const next = this.at(row + 1, name);
        if (!Number.isNaN(next)) state[name] += share * (next - state[name]);
      }
    }
    state.t = Math.min(Math.max(t, this.at(0, 't')), this.last('t'));
    return state;
  }

  /**
   * Derive the acceleration by the motor from the row before to `row` [m/s²]: the car's, without
   * the other forces, so with limit, delay and lag. The newest row repeats the one before.
   */
  #derive(row) {
    const known = row > 0 && !this.jumps(row - 1);
    const of = (name, at = row - 1) => this.at(at, name);
    const acting = known
      ? (of('speed', row) - of('speed')) / (of('t', row) - of('t'))
        - (of('gravity') + of('drag') + of('friction')) / this.mass
      : NaN;
    for (const at of known ? [row - 1, row] : [row]) {
      this.data[at * this.columns.length + this.index.acting] = acting;
    }
  }

  /** Derive the position of the charts [m]: along the road, or in the lap of a track. */
  #place(row) {
    const place = this.track ? this.track.place(this.at(row, 's')) : this.at(row, 'x');
    this.data[row * this.columns.length + this.index.place] = place;
  }

  /** Use the position in the lap of this track; null: the position along the road. */
  use(track) {
    this.track = track;
    for (let row = 0; row < this.count; row += 1) this.#place(row);
  }

  #grow() {
    const larger = new Float64Array(2 * this.data.length);
    larger.set(this.data);
    this.data = larger;
  }

  /** Drop every second row of the older half, but none that begins or ends a lap. */
  #thin() {
    const width = this.columns.length;
    const half = this.count >> 1;
    let kept = 1;
    for (let row = 1; row < this.count; row += 1) {
      const plain = row < half && row % 2 && !this.jumps(row) && !this.jumps(row - 1);
      if (plain) continue;
      this.data.copyWithin(kept * width, row * width, (row + 1) * width);
      kept += 1;
    }
    this.count = kept;
  }
}

const MOVING = [
  'x', 'y', 'psi', 'speed', 'measured_speed', 'absolute_speed', 'elevation', 'servo',
  'place', 's', 'e_y', 'e_psi', 'steer_feedforward', 'steer_of_e_y', 'steer_of_e_psi',
];
