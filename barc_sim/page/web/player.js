// The shown time: plays a recorded run, or freezes a live one at an earlier time.

import { isForControl } from './drive.js';
import { reading, show } from './look.js';

const SKIP = 1; // [s] that an arrow key seeks

export class Player {
  constructor(history) {
    this.history = history;
    this.time = 0;
    this.recorded = false;
    this.playing = false;
    this.held = false; // of a live run: whether the shown time is frozen
    this.last = null;
    this.button = document.getElementById('play');
    this.slider = document.getElementById('seek');
    this.text = document.getElementById('seek-time');
    this.pace = document.getElementById('pace');
    this.button.addEventListener('click', () => {
      if (this.recorded) this.#play(!this.playing);
      else this.hold(!this.held);
    });
    this.slider.addEventListener('input', () => this.seek(Number(this.slider.value)));
    addEventListener('keydown', (event) => this.#onKey(event));
  }

  /** Prepare a recorded run; `missed` is its count of missed deadlines. */
  begin({ missed }) {
    this.recorded = true;
    document.getElementById('state').hidden = true;
    this.button.title = '';
    document.getElementById('missed').textContent = missed;
    this.time = 0;
  }

  /** Play the recorded run, once it is loaded. */
  loaded() {
    this.slider.max = this.history.last('t');
    this.#play(true);
  }

  /** Freeze a live run at the shown time, or follow it again. */
  hold(held) {
    this.held = held;
    this.button.textContent = held ? 'Back to live' : 'Freeze';
  }

  /** Show a time [s]. */
  seek(time) {
    if (!this.history.count) return;
    this.time = Math.min(Math.max(time, this.history.at(0, 't')), this.history.last('t'));
    if (!this.recorded) this.hold(true);
  }

  /** Return the time [s] to show at `now` [s]; `live` [s] is the time of the live run. */
  advance(now, live) {
    const end = this.history.last('t');
    if (this.recorded) this.#advanceRecorded(now, end);
    else if (!this.held) this.time = live;
    if (Number.isNaN(end) || Number.isNaN(this.time)) return this.time;
    show(this.text, `${reading(this.time, 1)} / ${reading(end, 1)} s`);
    if (!this.recorded) {
      this.slider.min = this.history.at(0, 't');
      this.slider.max = end;
    }
    if (!this.slider.matches(':active')) this.slider.value = this.time;
    return this.time;
  }

  #advanceRecorded(now, end) {
    const pace = Number(this.pace.value);
    if (this.playing && this.last !== null) this.time += pace * (now - this.last);
    this.last = now;
    if (this.time >= end) {
      this.time = end;
      if (this.playing) this.#play(false);
    }
    show(document.getElementById('factor'), reading(this.playing ? pace : 0, 2));
  }

  /** Space plays and pauses, left and right seek, unless a focused control uses the key. */
  #onKey(event) {
    if (!this.recorded || event.ctrlKey || event.altKey || event.metaKey) return;
    const seeks = { ArrowLeft: -SKIP, ArrowRight: SKIP }[event.code];
    const target = event.target instanceof Element ? event.target : document.body;
    if (event.code === 'Space' && (target === this.slider || !isForControl(event))) {
      if (!event.repeat) this.#play(!this.playing);
    } else if (seeks && (target === this.slider || !target.matches('input, select, textarea'))) {
      this.seek(this.time + seeks);
    } else {
      return;
    }
    event.preventDefault();
  }

  #play(playing) {
    if (playing && this.time >= this.history.last('t')) this.time = 0;
    this.playing = playing;
    this.button.textContent = playing ? 'Pause' : 'Play';
  }
}
