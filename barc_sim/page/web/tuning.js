// Sliders that set the controller's parameters while it drives.

import { make } from './look.js';

const PERIOD = 100; // [ms] between two settings while a slider moves
const STEPS = 200; // of a slider

export class Tuning {
  /** `set` takes a parameter's name and its value. */
  constructor(set) {
    this.presets = document.getElementById('presets');
    this.note = document.getElementById('tuning-note');
    this.set = set;
    this.form = document.getElementById('tuning');
    this.form.addEventListener('submit', (event) => event.preventDefault());
    this.#build({});
  }

  /** Show the controller's sliders, {name: {label, max}}, and the values that it has. */
  show(sliders, values) {
    if (JSON.stringify(sliders) !== JSON.stringify(this.sliders)) this.#build(sliders);
    for (const [name, value] of Object.entries(values)) {
      this.values[name] = value;
      const { slider, number } = this.inputs[name];
      if (document.activeElement !== number && !slider.matches(':active')) this.#place(name, value);
      slider.disabled = number.disabled = false;
    }
  }

  /** Offer presets: {name: {gain: value}}. */
  offer(presets) {
    const known = JSON.stringify(presets);
    if (known === this.offered) return;
    this.offered = known;
    this.presets.hidden = !Object.keys(presets).length;
    this.presets.replaceChildren(...Object.entries(presets).map(([name, gains]) => make('button', {
      type: 'button',
      textContent: name,
      title: Object.entries(gains).map(([gain, value]) => `${gain} ${value}`).join(', '),
      onclick: () => {
        for (const [gain, value] of Object.entries(gains)) {
          this.#place(gain, value);
          this.set(gain, value);
        }
      },
    })));
  }

  /** Return the command that runs with the present values; `type` is the controller's. */
  command(type) {
    const shown = Object.keys(this.values).map((name) => [name, this.inputs[name].number.valueAsNumber]);
    const { speed_reference: speed, acceleration_limit: limit, ...gains } = Object.fromEntries(shown);
    return [
      'barc acc',
      ...(type === 'pid' ? [] : [`--controller-type ${type}`]),
      ...Object.entries(gains).map(([name, value]) => `--gain ${name}=${value}`),
      ...(speed === undefined ? [] : [`--speed ${speed}`]),
      ...(limit === undefined || limit === 8 ? []
        : [`--ros-args -p controller:acceleration_limit:=${limit.toFixed(6).replace(/0+$/, '0')}`]),
    ].join(' ');
  }

  /** Show why a value was refused, and the present one. */
  refuse(name, why) {
    this.note.textContent = `${name} was refused: ${why}`;
    if (name in this.values) this.#place(name, this.values[name]);
  }

  #build(sliders) {
    this.sliders = sliders;
    this.values = {};
    this.inputs = {};
    this.form.replaceChildren(
      ...Object.entries(sliders).map(([name, facts]) => this.#row(name, facts)),
    );
  }

  #row(name, { label, max }) {
    const row = document.createElement('div');
    row.className = 'tune';
    const slider = Object.assign(document.createElement('input'), {
      type: 'range', id: `${name}-slider`, min: 0, max, step: max / STEPS, disabled: true,
    });
    const number = Object.assign(document.createElement('input'), {
      type: 'number', id: name, step: 'any', disabled: true,
    });
    const title = Object.assign(document.createElement('label'), {
      htmlFor: name, textContent: label,
    });
    slider.setAttribute('aria-label', label);
    this.inputs[name] = { slider, number };
    let [timer, waiting] = [null, null];
    const send = (value) => {
      this.note.textContent = '\u00a0';
      waiting = value;
      if (timer !== null) return;
      this.set(name, value);
      waiting = null;
      timer = setTimeout(() => {
        timer = null;
        if (waiting !== null) send(waiting);
      }, PERIOD);
    };
    slider.addEventListener('input', () => {
      number.value = slider.value;
      send(Number(slider.value));
    });
    number.addEventListener('change', () => {
      const value = number.valueAsNumber;
      if (Number.isFinite(value)) send(value);
      else this.#place(name, this.values[name]);
    });
    row.append(title, number, slider);
    return row;
  }

  #place(name, value) {
    const { slider, number } = this.inputs[name];
    slider.max = Math.max(this.sliders[name].max, value);
    slider.value = value;
    number.value = Number(value.toPrecision(6));
  }
}
