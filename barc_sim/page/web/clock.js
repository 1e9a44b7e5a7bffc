// Simulated time as the page shows it: even, where states arrive in bunches.

const DELAY = 0.06; // [s] behind the newest state, so that there is one on either side
const LOST = 0.4; // [s] off by which it jumps

export class Clock {
  constructor() {
    this.restart();
  }

  restart() {
    this.time = NaN;
    this.rate = 1;
    this.seen = null;
  }

  /** Return the time [s] to show at `now` [s], where the newest state is of `newest` [s]. */
  advance(now, newest) {
    if (Number.isNaN(newest)) { // nothing has arrived yet
      this.restart();
      return NaN;
    }
    const passed = this.seen ? Math.min(now - this.seen.now, 0.25) : 0;
    this.#measure(now, newest);
    const goal = newest - DELAY * this.rate;
    const off = goal - this.time;
    if (!(Math.abs(off) < LOST * Math.max(this.rate, 1))) {
      this.time = goal;
    } else {
      const pull = 1 - Math.exp(-passed / 0.25);
      this.time += Math.max(0, passed * this.rate + off * pull);
    }
    // Once no more states come, it runs up to the last.
    if (this.rate < 0.05) this.time = Math.max(this.time, newest);
    this.time = Math.min(this.time, newest);
    return this.time;
  }

  /** Follow how fast simulated time goes. */
  #measure(now, newest) {
    this.seen ??= { now, since: now, newest };
    this.seen.now = now;
    const span = now - this.seen.since;
    if (span < 0.25) return;
    const measured = (newest - this.seen.newest) / span;
    this.rate = measured <= 0 ? 0 : this.rate + 0.5 * (measured - this.rate);
    this.seen.since = now;
    this.seen.newest = newest;
  }
}
