// What the charts show: axis, zoom, the cursor, ghosts of other laps; and their legends.

import { make, reading, save, show } from './look.js';

const WINDOW = 20; // [s] visible at first
const MINIMUM = 0.2; // [s] or [m], the smallest visible range
const ZOOM = 1.25; // by one step of the wheel
const RUN_UP = 10; // [m] without effect on the scale: its errors are far larger than on the hills
const SAMPLES = 2048; // rows that slopes are taken from
const DASHES = { last: [3, 4], best: [9, 4], other: [6, 3] };

export class Explorer {
  /** `charts`: {chart, legend}; `player` holds and seeks; `changed` is called after a change. */
  constructor(history, player, charts, changed) {
    Object.assign(this, { history, player, charts, changed });
    this.axis = 't'; // or 'place', along the road or the track
    this.window = WINDOW; // [s]
    this.range = null; // [m] that is zoomed into, on the axis of position
    this.hover = null; // a value on the axis
    this.laps = null; // beside the shown state: {last, best}
    this.other = null; // {history, laps, name}: a second run
    this.hidden = new Set(); // ghosts
    for (const { chart } of charts) this.#listen(chart);
    const on = (id, call) => document.getElementById(id).addEventListener('click', call);
    on('zoom-in', () => this.#zoom(1 / ZOOM ** 2));
    on('zoom-out', () => this.#zoom(ZOOM ** 2));
    on('save-csv', () => this.saveTable());
    document.getElementById('axis').addEventListener('change', (event) => {
      this.use(event.target.value);
      changed();
    });
    for (const name of ['last', 'best']) {
      on(`ghost-${name}`, (event) => {
        const shown = this.hidden.delete(name);
        if (!shown) this.hidden.add(name);
        event.currentTarget.setAttribute('aria-pressed', shown);
        changed();
      });
    }
  }

  /** Draw over time, 't', or position, 'place'. */
  use(axis) {
    this.axis = axis;
    this.hover = null;
    for (const { chart } of this.charts) chart.shown = null;
  }

  /** Name the lines of a chart in its legend; each name is a button that hides its line. */
  name({ chart, legend }) {
    legend.replaceChildren(...chart.lines.toReversed().map((line) => {
      const value = make('span', { className: 'value' });
      const button = make('button', {
        type: 'button',
        className: `line-${line.colour}${line.dash ? ' dashed' : ''}`,
        onclick: () => {
          line.hidden = !line.hidden;
          button.setAttribute('aria-pressed', !line.hidden);
          this.changed();
        },
      }, line.name ?? line.column, ' ', value);
      button.setAttribute('aria-pressed', !line.hidden);
      line.output = value;
      return make('li', {}, button);
    }));
  }

  /** Show or hide a line, by its column. */
  reveal(column, shown) {
    for (const { chart } of this.charts) {
      for (const line of chart.lines) {
        if (line.column !== column || line.hidden === !shown) continue;
        line.hidden = !shown;
        line.output.parentElement.setAttribute('aria-pressed', shown);
      }
    }
  }

  /** Return the ghosts of a state: {name, history, start, end, shift [s]}. */
  ghosts(state) {
    const row = this.history.row(state.t);
    const lap_time = this.history.at(row, 'lap_time'); // of a track, from line to line
    const began = Number.isNaN(lap_time) ? this.history.at(this.history.lapStart(row), 't')
      : this.history.at(row, 't') - lap_time;
    const ghosts = [];
    if (this.other?.history.count) {
      const { history, laps } = this.other;
      const { start, end } = laps.get(state.lap) ?? laps.latest.current;
      ghosts.push({ name: 'other', history, start, end, shift: began - start });
      return ghosts;
    }
    const { track } = this.history; // on which the best lap is enough
    for (const name of track ? ['best'] : ['last', 'best']) {
      const lap = this.laps?.[name];
      const twice = !track && name === 'best' && lap?.number === this.laps?.last?.number && !this.hidden.has('last');
      if (!lap || this.hidden.has(name) || twice || lap.number === state.lap) continue;
      if (lap.start < this.history.at(0, 't')) continue;
      ghosts.push({
        name, history: this.history, start: lap.start, end: lap.end, shift: began - lap.start,
      });
    }
    return ghosts;
  }

  draw(state, road) {
    if (!state) return;
    const view = this.#view(state, road);
    for (const { chart } of this.charts) chart.draw(this.history, state, view);
    const at = this.hover === null ? state : this.#stateAt(view);
    for (const { chart } of this.charts) {
      for (const line of chart.lines) {
        const value = at[line.column] * (line.scale ?? 1);
        show(line.output, reading(value, line.column === 'reference' ? 2 : 3));
      }
    }
  }

  #view(state, road) {
    const { history, axis } = this;
    const last = history.row(state.t);
    let range;
    let first;
    if (axis === 't') {
      const to = Math.max(state.t, history.at(0, 't') + this.window);
      range = [to - this.window, to];
      first = history.row(range[0]);
    } else {
      range = this.range ?? road.around(state.place);
      first = history.lapStart(last);
    }
    const ghosts = this.ghosts(state).map((ghost) => {
      const rows = [ghost.history.row(ghost.start), ghost.history.row(ghost.end)];
      if (axis === 't') {
        rows[0] = Math.max(rows[0], ghost.history.row(range[0] - ghost.shift));
        rows[1] = Math.min(rows[1], ghost.history.row(range[1] - ghost.shift) + 1);
      }
      return {
        history: ghost.history,
        first: rows[0],
        last: Math.min(rows[1], ghost.history.count - 1),
        shift: axis === 't' ? ghost.shift : 0,
        dash: DASHES[ghost.name],
      };
    });
    const from = document.body.dataset.mode === 'acc' ? RUN_UP : -Infinity;
    this.seen = { axis, range, first, last, ghosts, from, cursor: this.hover, slopes: [] };
    this.seen.slopes = axis === 't' ? this.#slopesOverTime() : road.slopes;
    return this.seen;
  }

  #slopesOverTime() {
    const { history, seen: { first, last } } = this;
    const stride = Math.max(1, Math.floor((last - first) / SAMPLES));
    const slopes = [];
    let slope = null;
    for (let row = first; row <= last; row += stride) {
      const grade = history.at(row, 'theta_deg') || 0;
      const t = history.at(row, 't');
      if (slope && slope.grade === grade) {
        slope.to = t;
      } else {
        if (slope) slope.to = t;
        slope = { from: t, to: t, grade };
        if (grade) slopes.push(slope);
      }
    }
    return slopes;
  }

  /** Return the recorded state under the pointer. */
  #stateAt({ axis, first, last }) {
    let row = first;
    if (axis === 't') {
      row = Math.min(Math.max(this.history.row(this.hover), first), last);
    } else {
      let nearest = Infinity;
      for (let i = first; i <= last; i += 1) {
        const off = Math.abs(this.history.at(i, 'place') - this.hover);
        if (off < nearest) [nearest, row] = [off, i];
      }
    }
    return this.history.state(this.history.at(row, 't'));
  }

  #zoom(factor, at = null) {
    if (!this.seen) return;
    const [from, to] = this.seen.range;
    if (this.axis === 't') {
      const whole = Math.max(this.history.last('t') - this.history.at(0, 't'), WINDOW);
      const window = Math.min(Math.max(this.window * factor, MINIMUM), whole);
      if (at !== null && (this.player.held || (this.player.recorded && !this.player.playing))) {
        const share = (to - at) / (to - from);
        this.player.seek(at + share * window); // what is under the pointer stays there
      }
      this.window = window;
    } else {
      const middle = at ?? (from + to) / 2;
      const range = [middle - (middle - from) * factor, middle + (to - middle) * factor];
      this.range = range[1] - range[0] > MINIMUM ? range : this.range;
    }
    this.changed();
  }

  #pan(by) {
    if (this.axis === 't') this.player.seek(this.player.time - by);
    else this.range = this.seen.range.map((limit) => limit - by);
    this.changed();
  }

  #listen(chart) {
    const { canvas } = chart.surface;
    const place = (event) => event.clientX - canvas.getBoundingClientRect().left;
    const value = (x) => chart.value(x, this.seen.range);
    let dragged = null; // [px] where it was
    canvas.addEventListener('wheel', (event) => {
      if (!this.seen) return;
      event.preventDefault();
      this.#zoom(event.deltaY > 0 ? ZOOM : 1 / ZOOM, value(place(event)));
    }, { passive: false });
    canvas.addEventListener('pointerdown', (event) => {
      dragged = place(event);
      canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener('pointermove', (event) => {
      if (!this.seen) return;
      const x = place(event);
      if (dragged === null || event.pointerType !== 'mouse') this.hover = value(x);
      if (dragged !== null && x !== dragged) {
        this.#pan(value(x) - value(dragged));
        dragged = x;
      }
      this.changed();
    });
    canvas.addEventListener('lostpointercapture', () => { dragged = null; });
    canvas.addEventListener('pointerleave', () => {
      this.hover = null;
      this.changed();
    });
    canvas.addEventListener('dblclick', () => {
      this.range = null;
      this.window = WINDOW;
      this.changed();
    });
  }

  /** Save all states that the page has as CSV. */
  saveTable() {
    const { columns, count, data } = this.history;
    const lines = [columns.join(',')];
    for (let row = 0; row < count; row += 1) {
      const values = data.subarray(row * columns.length, (row + 1) * columns.length);
      lines.push(Array.from(values, (v) => (Number.isNaN(v) ? '' : v)).join(','));
    }
    save('run.csv', new Blob([lines.join('\n'), '\n'], { type: 'text/csv' }));
  }
}
