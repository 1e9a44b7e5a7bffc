// The parameters at any time of the run, so that an earlier state is shown with its own.

const MAXIMUM = 1000; // changes that are kept

export class Settings {
  constructor() {
    this.changes = []; // {from [s], values}
  }

  /** Take the values that hold from the time `from` [s] on. */
  add(from, values) {
    // If time has gone back, a new run has begun.
    this.changes = this.changes.filter((change) => change.from < from).slice(-MAXIMUM);
    this.changes.push({ from, values });
  }

  /** Return the values at a time [s]; before the first change, those that are known first. */
  at(t) {
    const change = this.changes.findLast(({ from }) => from <= t) ?? this.changes[0];
    return change?.values ?? {};
  }
}
