// Sliders that set parameters of the controller and the car while it drives.

import { make, quote, show } from './look.js';

const PERIOD = 100; // [ms] between two settings while a slider moves
const STEPS = 200; // of a slider
// The headings of other nodes' sliders, below the controller's.
const TITLES = { vehicle_simulator: ['Car ', make('small', {}, '0: none')] };
// What to see, and to try next, with each preset.
const ABOUT = {
  P: 'Each slope leaves an error: P needs one to give a command. Raise kp, then add ki.',
  PI: 'I removes the error on each slope, after a while. Raise ki: when does the speed swing?',
  PID: 'D damps fast changes. Add noise to the car: how does the command change?',
  Tuned: 'The RMS error of a lap is 0.021 m/s: kp and ki can halve it. Or begin with P.',
  'Too much I': 'I corrects too late and too much: the speed swings. Raise kp, or lower ki.',
  Noise: 'D turns the noise into large commands. Lower kd: what gets better, and what gets worse?',
  Delay: 'The motor reacts 0.2 s late, and the speed swings. Which gain must be lower?',
  Windup: 'The motor is at its limit, and I keeps growing. Lower the limit of the controller to 6.',
};
const USUAL = {
  acceleration_limit: 8, road: 'lab', distance: 180, laps: 1, lane: '',
};

export class Tuning {
  /** `set` takes a parameter's name and its value. */
  constructor(set) {
    this.presets = document.getElementById('presets');
    this.note = document.getElementById('tuning-note');
    this.set = set;
    this.form = document.getElementById('tuning');
    this.form.addEventListener('submit', (event) => event.preventDefault());
    const more = document.getElementById('more'); // on a phone
    more.addEventListener('click', () => {
      more.ariaExpanded = this.form.classList.toggle('all');
    });
    this.#build({});
  }

  /** Show the sliders, {name: {label, max, node}}, and the values that they have. */
  show(sliders, values) {
    if (JSON.stringify(sliders) !== JSON.stringify(this.sliders)) this.#build(sliders);
    for (const [name, value] of Object.entries(values)) {
      this.values[name] = value;
      const { slider, number } = this.inputs[name];
      if (document.activeElement !== number && !slider.matches(':active')) this.#place(name, value);
      slider.disabled = number.disabled = false;
    }
  }

  /** Offer presets, {name: {gain: value}}; one that has the present values is pressed, and explained. */
  offer(presets) {
    const known = JSON.stringify(presets);
    if (known !== this.offered) this.#offer(presets);
    this.offered = known;
    let shown;
    for (const button of this.presets.children) {
      const gains = Object.entries(presets[button.textContent]);
      const pressed = gains.every(([gain, value]) => this.values[gain] === value);
      button.ariaPressed = pressed;
      if (pressed) shown = ABOUT[button.textContent];
    }
    show(document.getElementById('preset-note'), shown ?? '');
  }

  #offer(presets) {
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

  /** Return the command of such a `run` with the present values; `type` is the controller's. */
  command(type, run) {
    const words = ['barc acc'];
    const car = [];
    if (type !== 'pid') words.push(`--controller-type ${type}`);
    for (const [name, { node }] of Object.entries(this.sliders)) {
      if (!(name in this.values)) continue;
      const value = this.inputs[name].number.valueAsNumber;
      if (node === 'vehicle_simulator') {
        if (value) car.push(`-p ${node}:${name}:=${Number.isInteger(value) ? value.toFixed(1) : value}`);
      } else if (name === 'speed_reference') {
        words.push(`--speed ${value}`);
      } else if (name === 'acceleration_limit') {
        if (value !== USUAL[name]) words.push(`--acceleration-limit ${value}`);
      } else if (name.startsWith('lane.')) {
        words.push(`--lane-gain ${name.slice(5)}=${value}`);
      } else {
        words.push(`--gain ${name}=${value}`);
      }
    }
    for (const [name, value] of Object.entries(run)) {
      if (value !== USUAL[name]) words.push(`--${name} ${quote(String(value))}`);
    }
    if (car.length) words.push('--ros-args', ...car);
    return words.join(' ');
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
    const rows = Object.entries(sliders).map(([name, facts]) => [facts.node, this.#row(name, facts)]);
    const groups = Object.groupBy(rows, ([node]) => node);
    this.form.replaceChildren(...Object.entries(groups).flatMap(([node, members]) => [
      ...(node in TITLES ? [make('h3', {}, ...TITLES[node])] : []),
      ...members.map(([, row]) => row),
    ]));
  }

  #row(name, { label, short, unit, max }) {
    const row = document.createElement('div');
    row.className = 'tune';
    const slider = Object.assign(document.createElement('input'), {
      type: 'range', id: `${name}-slider`, min: 0, max, step: max / STEPS, disabled: true,
    });
    const number = Object.assign(document.createElement('input'), {
      type: 'number', id: name, step: 'any', disabled: true,
    });
    const title = make('label', { htmlFor: name, title: label }, `${short} `, make('small', {}, unit));
    for (const input of [slider, number]) input.ariaLabel = label;
    this.inputs[name] = { slider, number };
    let [timer, waiting] = [null, null];
    const send = (value) => {
      this.note.textContent = '';
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
    row.append(title, slider, number);
    return row;
  }

  #place(name, value) {
    const { slider, number } = this.inputs[name];
    slider.value = value; // the slider ends where its range does; the number shows all
    const shown = Number(value.toPrecision(6));
    number.value = Math.abs(shown) < 1e6 ? shown : shown.toExponential(); // what the box holds
  }
}
