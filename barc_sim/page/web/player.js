// A recorded run: play, pause, and the time slider.

import { reading } from './look.js';

export class Player {
  constructor(history) {
    this.history = history;
    this.time = 0;
    this.playing = false;
    this.seen = null;
    this.button = document.getElementById('play');
    this.slider = document.getElementById('seek');
    this.text = document.getElementById('seek-time');
    this.pace = document.getElementById('pace');
    this.button.addEventListener('click', () => this.#play(!this.playing));
    this.slider.addEventListener('input', () => { this.time = Number(this.slider.value); });
  }

  /** Play a run from its start; `facts`: title, missed. */
  begin({ missed }) {
    document.getElementById('state').hidden = true;
    document.getElementById('missed').textContent = missed;
    this.time = 0;
  }

  /** The run is there. */
  loaded() {
    this.slider.max = this.history.last('t');
    this.#play(true);
  }

  /** Return the time [s] of the run to show at `now` [s]. */
  advance(now) {
    const end = this.history.last('t');
    const pace = Number(this.pace.value);
    if (this.playing && this.seen !== null) this.time += pace * (now - this.seen);
    this.seen = now;
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
