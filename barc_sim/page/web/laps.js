// The laps of a run, by their numbers.

export class Laps {
  constructor() {
    this.finished = new Map();
    this.latest = null; // {count, current, last, best}, and on a track the rows of a table
  }

  /** Take the present and the best lap, and laps that have ended since. */
  update({ finished = [], ...latest }) {
    for (const lap of finished) this.finished.set(lap.number, lap);
    this.latest = latest;
  }

  /** Return a lap by its number; null if it is unknown. */
  get(number) {
    const current = this.latest?.current;
    return this.finished.get(number) ?? (current?.number === number ? current : null);
  }

  /** Return the laps to show beside a state of lap `number`: {current, last, best}. */
  beside(number) {
    return { current: this.get(number), last: this.get(number - 1), best: this.latest?.best ?? null };
  }
}
