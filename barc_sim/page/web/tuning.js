// Sliders that set parameters of the controller and the car while it drives.

import { Control } from './control.js';
import { make, quote, show } from './look.js';
import { Parameters } from './parameters.js';

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
  /** `send` takes a parameter's name and its value. */
  constructor(send) {
    this.presets = document.getElementById('presets');
    this.form = document.getElementById('tuning');
    this.note = document.getElementById('tuning-note');
    this.offered = {}; // presets, {name: {parameter: value}}
    this.sliders = {}; // {name: {label, short, unit, max, limits, expected, node}}
    this.controls = {};
    this.warn = (sentence) => {
      show(this.note, sentence);
      if (sentence) this.note.scrollIntoView({ block: 'nearest' }); // it is below the sliders
    };
    this.parameters = new Parameters(send, () => this.#render(), this.warn);
    this.form.addEventListener('submit', (event) => event.preventDefault());
    const more = document.getElementById('more'); // on a phone
    more.addEventListener('click', () => {
      more.ariaExpanded = this.form.classList.toggle('all');
    });
  }

  /** Show the sliders, the presets, and the values that the parameters have. */
  receive({ sliders, presets, tuning }) {
    if (JSON.stringify(sliders) !== JSON.stringify(this.sliders)) this.#build(sliders);
    if (JSON.stringify(presets) !== JSON.stringify(this.offered)) this.#offer(presets);
    this.parameters.receive(tuning);
  }

  /** Return the command of such a `run` with the present values; `type` is the controller's. */
  command(type, run) {
    const words = ['barc acc'];
    const car = [];
    if (type !== 'pid') words.push(`--controller-type ${type}`);
    for (const [name, { node }] of Object.entries(this.sliders)) {
      const value = this.parameters.shown(name);
      if (value === undefined) continue;
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

  #build(sliders) {
    this.sliders = sliders;
    const enter = (name) => (value) => this.parameters.request(name, value);
    this.controls = Object.fromEntries(Object.entries(sliders).map(
      ([name, facts]) => [name, new Control(name, facts, enter(name), this.warn)],
    ));
    const groups = Object.groupBy(Object.keys(sliders), (name) => sliders[name].node);
    this.form.replaceChildren(...Object.entries(groups).flatMap(([node, names]) => [
      ...(node in TITLES ? [make('h3', {}, ...TITLES[node])] : []),
      ...names.map((name) => this.controls[name].row),
    ]));
  }

  #offer(presets) {
    this.offered = presets;
    this.presets.hidden = !Object.keys(presets).length;
    this.presets.replaceChildren(...Object.entries(presets).map(([name, values]) => make('button', {
      type: 'button',
      textContent: name,
      title: Object.entries(values).map(([parameter, value]) => `${parameter} ${value}`).join(', '),
      onclick: () => {
        for (const [parameter, value] of Object.entries(values)) {
          this.parameters.request(parameter, value);
        }
      },
    })));
  }

  /** Show every value; a preset whose values all are set is pressed, and explained. */
  #render() {
    const { parameters } = this;
    for (const [name, control] of Object.entries(this.controls)) {
      control.show(parameters.shown(name), parameters.isEnabled(name));
    }
    let explanation = '';
    for (const button of this.presets.children) {
      const values = Object.entries(this.offered[button.textContent]);
      const isSet = values.every(([name, value]) => parameters.values[name] === value);
      button.ariaPressed = isSet;
      button.disabled = !values.every(([name]) => parameters.isEnabled(name));
      if (isSet) explanation = ABOUT[button.textContent] ?? '';
    }
    show(document.getElementById('preset-note'), explanation);
  }
}
