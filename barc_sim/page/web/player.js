// Plays a recorded run, with a time slider.

import { isForControl } from './drive.js';
import { reading } from './look.js';

const SKIP = 1; // [s] that an arrow key seeks

export class Player {
  constructor(history) {
    this.history = history;
    this.time = 0;
    this.ready = false;
    this.playing = false;
    this.last = null;
    this.button = document.getElementById('play');
    this.slider = document.getElementById('seek');
    this.text = document.getElementById('seek-time');
    this.pace = document.getElementById('pace');
    this.button.addEventListener('click', () => this.#play(!this.playing));
    this.slider.addEventListener('input', () => { this.time = Number(this.slider.value); });
    addEventListener('keydown', (event) => this.#onKey(event));
  }

  /** Space plays and pauses, left and right seek, unless a focused control uses the key. */
  #onKey(event) {
    if (!this.ready || event.ctrlKey || event.altKey || event.metaKey) return;
    const seeks = { ArrowLeft: -SKIP, ArrowRight: SKIP }[event.code];
    const target = event.target instanceof Element ? event.target : document.body;
    if (event.code === 'Space' && (target === this.slider || !isForControl(event))) {
      if (!event.repeat) this.#play(!this.playing);
    } else if (seeks && (target === this.slider || !target.matches('input, select, textarea'))) {
      this.time = Math.min(Math.max(this.time + seeks, 0), this.history.last('t'));
    } else {
      return;
    }
    event.preventDefault();
  }

  /** Prepare a run; `missed` is its count of missed deadlines. */
  begin({ missed }) {
    document.getElementById('state').hidden = true;
    document.getElementById('missed').textContent = missed;
    this.time = 0;
  }

  /** Play the run, once it is loaded. */
  loaded() {
    this.ready = true;
    this.slider.max = this.history.last('t');
    this.#play(true);
  }

  /** Return the time [s] of the run to show at `now` [s]. */
  advance(now) {
    const end = this.history.last('t');
    const pace = Number(this.pace.value);
    if (this.playing && this.last !== null) this.time += pace * (now - this.last);
    this.last = now;
    if (this.time >= end) {
      this.time = end;
      if (this.playing) this.#play(false);
    }
    const text = `${reading(this.time, 1)} / ${reading(end, 1)} s`;
    if (this.text.textContent !== text) this.text.textContent = text;
    if (!this.slider.matches(':active')) this.slider.value = this.time;
    document.getElementById('factor').textContent = reading(this.playing ? pace : 0, 2);
    return this.time;
  }

  #play(playing) {
    if (playing && this.time >= this.history.last('t')) this.time = 0;
    this.playing = playing;
    this.button.textContent = playing ? 'Pause' : 'Play';
  }
}
