// The simulated time to show: it runs evenly, even if states arrive in bunches.

const DELAY = 0.06; // [s] behind the newest state, to interpolate between two
const LOST = 0.4; // [s] With a larger error, the time jumps.

export class Clock {
  constructor() {
    this.restart();
  }

  restart() {
    this.time = NaN;
    this.rate = 1;
    this.measured = null;
  }

  /** Return the time [s] to show at `now` [s]; `newest` [s] is the time of the newest state. */
  advance(now, newest) {
    if (Number.isNaN(newest)) { // nothing has arrived yet
      this.restart();
      return NaN;
    }
    const passed = this.measured ? Math.min(now - this.measured.now, 0.25) : 0;
    this.#measure(now, newest);
    const goal = newest - DELAY * this.rate;
    const off = goal - this.time;
    if (!(Math.abs(off) < LOST * Math.max(this.rate, 1))) {
      this.time = goal;
    } else {
      const pull = 1 - Math.exp(-passed / 0.25);
      this.time += Math.max(0, passed * this.rate + off * pull);
    }
    // When states stop, show the last one.
    if (this.rate < 0.05) this.time = Math.max(this.time, newest);
    this.time = Math.min(this.time, newest);
    return this.time;
  }

  /** Measure the rate of simulated time. */
  #measure(now, newest) {
    this.measured ??= { now, since: now, newest };
    this.measured.now = now;
    const span = now - this.measured.since;
    if (span < 0.25) return;
    const rate = (newest - this.measured.newest) / span;
    this.rate = rate <= 0 ? 0 : this.rate + 0.5 * (rate - this.rate);
    this.measured.since = now;
    this.measured.newest = newest;
  }
}
