// Adds a day of rows to a history of 1,000; returns its size, first and last time, and laps.
import('./history.js').then(({ History }) => {
  const history = new History(1000);
  history.name(['t', 'lap'], false);
  for (let k = 0; k < 20000; k += 1) {
    history.add(new Float64Array([0.02 * k, Math.floor(k / 5000)]));
  }
  const laps = [];
  for (let row = 0; row + 1 < history.count; row += 1) {
    if (history.jumps(row)) laps.push(history.at(row + 1, 't'));
  }
  return [history.count, history.at(0, 't'), history.last('t'), laps];
})
