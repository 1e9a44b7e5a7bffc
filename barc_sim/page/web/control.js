// A slider and a number field that show one value, and enter it.

import { make } from './look.js';

const STEPS = 200; // of a slider
const KEYS = {
  ArrowUp: 1, ArrowRight: 1, ArrowDown: -1, ArrowLeft: -1,
};

/** Return a number without the rounding errors of its last digits. */
const exact = (value) => Number(value.toPrecision(12));

/** Return a value as the number field shows it. */
function format(value) {
  const shown = Number(value.toPrecision(6));
  return Math.abs(shown) < 1e6 ? String(shown) : shown.toExponential();
}

export class Control {
  /**
   * `facts`: {label, short, unit, max, limits, expected}. `enter` takes a value that the user
   * gives; `warn` takes a sentence.
   */
  constructor(name, facts, enter, warn) {
    Object.assign(this, { name, facts, enter, warn });
    this.value = undefined; // as shown; undefined: unknown
    this.isTyping = false;
    this.slid = null; // the last value that the slider gave
    this.slider = make('input', { type: 'range', id: `${name}-slider`, step: 'any', disabled: true });
    this.number = make('input', { type: 'number', id: name, step: 'any', disabled: true });
    [this.number.min, this.number.max] = facts.limits;
    this.number.title = facts.expected;
    for (const input of [this.slider, this.number]) {
      input.ariaLabel = facts.label;
      input.addEventListener('keydown', (event) => this.#onKey(event));
    }
    this.#listen();
    this.#fit(0);
    const unit = make('small', {}, facts.unit);
    const label = make('label', { htmlFor: name, title: facts.label }, `${facts.short} `, unit);
    this.row = make('div', { className: 'tune' }, label, this.slider, this.number);
  }

  /** Show a value in the slider and in the number, unless the user is typing another one. */
  show(value, isEnabled) {
    this.slider.disabled = this.number.disabled = !isEnabled;
    if (!isEnabled) this.isTyping = false;
    this.value = value;
    if (value === undefined) return;
    if (value !== this.slid) this.#fit(value);
    this.slider.value = value;
    if (!this.isTyping) this.number.value = format(value);
  }

  #listen() {
    this.slider.addEventListener('input', (event) => {
      const value = this.slider.valueAsNumber;
      this.slid = event.isTrusted ? this.#onGrid(value) : value;
      this.isTyping = false;
      this.enter(this.slid);
    });
    this.number.addEventListener('input', () => { this.isTyping = true; });
    this.number.addEventListener('change', () => {
      const value = this.number.valueAsNumber;
      this.isTyping = false;
      if (Number.isFinite(value)) {
        this.enter(value);
      } else {
        this.#showAgain();
        this.warn(`${this.name}: ${this.facts.expected} is expected`);
      }
    });
    this.number.addEventListener('blur', () => {
      this.isTyping = false;
      this.#showAgain();
    });
  }

  /** An arrow key changes the value by a step, from wherever it is. */
  #onKey(event) {
    const input = event.currentTarget;
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    if (event.key === 'Escape') {
      this.isTyping = false;
      this.#showAgain();
      return;
    }
    const isCursor = input === this.number && /Left|Right/.test(event.key);
    if (!(event.key in KEYS) || isCursor || this.value === undefined) return;
    event.preventDefault();
    const typed = this.number.valueAsNumber;
    const from = this.isTyping && Number.isFinite(typed) ? typed : this.value;
    const [low, high] = input === this.slider ? this.range : this.facts.limits;
    input.value = Math.min(Math.max(exact(from + KEYS[event.key] * this.step), low), high);
    for (const type of input === this.slider ? ['input'] : ['input', 'change']) {
      input.dispatchEvent(new Event(type, { bubbles: true }));
    }
  }

  #showAgain() {
    this.show(this.value, !this.number.disabled);
  }

  /** Give the slider a range that contains a value. */
  #fit(value) {
    const low = Math.max(this.facts.limits[0], 0);
    this.range = [Math.min(low, value), Math.max(this.facts.max, value)];
    [this.slider.min, this.slider.max] = this.range;
    this.step = (this.range[1] - this.range[0]) / STEPS;
  }

  /** Return the nearest whole number of steps, within the slider's range. */
  #onGrid(value) {
    const [low, high] = this.range;
    return Math.min(Math.max(exact(Math.round(value / this.step) * this.step), low), high);
  }
}
