// Sliders that set the controller's parameters while it drives.

const PARAMETERS = {
  kp: { label: 'Proportional, kp', max: 100, step: 0.5 },
  ki: { label: 'Integral, ki', max: 400, step: 1 },
  kd: { label: 'Derivative, kd', max: 5, step: 0.05 },
  speed_reference: { label: 'Speed reference, m/s', max: 20, step: 0.1 },
};
const PERIOD = 100; // [ms] between two settings while a slider moves

export class Tuning {
  /** `set` is given a parameter's name and its value. */
  constructor(set) {
    this.note = document.getElementById('tuning-note');
    this.values = {};
    this.inputs = {};
    const form = document.getElementById('tuning');
    form.addEventListener('submit', (event) => event.preventDefault());
    for (const [name, facts] of Object.entries(PARAMETERS)) form.append(this.#row(name, facts, set));
  }

  /** Show what the controller has. */
  show(values) {
    for (const [name, value] of Object.entries(values)) {
      this.values[name] = value;
      const { slider, number } = this.inputs[name];
      if (document.activeElement !== number && !slider.matches(':active')) this.#place(name, value);
      slider.disabled = number.disabled = false;
    }
  }

  /** Say why a value was refused, and show the one that holds. */
  refuse(name, why) {
    this.note.textContent = `${name} was refused: ${why}`;
    if (name in this.values) this.#place(name, this.values[name]);
  }

  #row(name, { label, max, step }, set) {
    const row = document.createElement('div');
    row.className = 'tune';
    const slider = Object.assign(document.createElement('input'), {
      type: 'range', id: `${name}-slider`, min: 0, max, step, disabled: true,
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
      set(name, value);
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
    slider.max = Math.max(PARAMETERS[name].max, value);
    slider.value = value;
    number.value = Number(value.toPrecision(6));
  }
}
