// Plays a recorded run, with a time slider.

import { reading } from './look.js';

export class Player {
  constructor(history) {
    this.history = history;
    this.time = 0;
    this.playing = false;
    this.last = null;
    this.button = document.getElementById('play');
    this.slider = document.getElementById('seek');
    this.text = document.getElementById('seek-time');
    this.pace = document.getElementById('pace');
    this.button.addEventListener('click', () => this.#play(!this.playing));
    this.slider.addEventListener('input', () => { this.time = Number(this.slider.value); });
  }

  /** Prepare a run; `missed` is its count of missed deadlines. */
  begin({ missed }) {
    document.getElementById('state').hidden = true;
    document.getElementById('missed').textContent = missed;
    this.time = 0;
  }

  /** Play the run, once it is loaded. */
  loaded() {
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
