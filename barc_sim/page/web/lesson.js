// The lesson beside the picture: forces, the controller's equation, laps, and the end.

import {
  copy, DEGREES, make, QUANTITIES, quote, reading, show, termColour,
} from './look.js';

const NAMES = { motor: 'Motor', gravity: 'Gravity', drag: 'Drag', friction: 'Friction' };

/** Return the forces along the road [N] that act at a state. */
export function forcesOf({ acting, gravity, drag, friction }, mass) {
  return { motor: mass * acting, gravity, drag, friction };
}

/** Return whether the motor gives less than the command, by its `limit` [m/s²]; 0: none. */
const isAtLimit = ({ acting, motor }, limit) => limit > 0
  && Math.abs(motor) > limit && Math.abs(acting) > 0.99 * limit;

export class Lesson {
  constructor() {
    this.forces = document.getElementById('forces');
    this.equation = document.getElementById('equation');
    this.laps = document.querySelectorAll('[data-figure]');
    this.gains = document.getElementById('lap-gains');
    this.card = document.getElementById('end-card');
  }

  /** Prepare the forces and the controller's terms, each in its colour. */
  prepare({ mode, terms }) {
    this.force = {};
    this.forces.replaceChildren(...Object.entries(NAMES).map(([name, label]) => {
      this.force[name] = make('span', { id: `force-${name}` });
      return make(
        'div', { className: `line-${QUANTITIES[name]}` },
        make('dt', {}, label),
        make('dd', {}, this.force[name], ' ', make('small', {}, 'N')),
      );
    }));
    this.term = {};
    const part = (name, label, colour) => {
      this.term[name] = make('span', { id: `term-${name}`, className: 'value' });
      return make('span', { className: `term line-${colour}` }, `${label} `, this.term[name]);
    };
    this.limited = make('span', { className: 'limited', hidden: true });
    this.terms = terms;
    this.parts = terms.map((name, i) => make(
      'span', {}, i ? '+\u2002' : '=\u2002', part(name, name.replace(/^steer_/, ''), termColour(i)),
    ));
    this.equation.replaceChildren(
      ...(mode === 'track'
        ? [part('servo', 'steering', QUANTITIES.servo), make('small', {}, '°')]
        : [part('motor', 'command', QUANTITIES.motor), make('small', {}, 'm/s²')]),
      this.limited,
      ...this.parts,
    );
  }

  update(state, { mode, mass, tuning }) {
    for (const [name, force] of Object.entries(forcesOf(state, mass))) {
      if (name in this.force) show(this.force[name], reading(force, Math.abs(force) < 10 ? 2 : 0));
    }
    const scale = mode === 'track' ? DEGREES : 1;
    for (const [name, output] of Object.entries(this.term)) show(output, reading(scale * state[name], 3));
    const unknown = this.terms.some((name) => !Number.isFinite(state[name])); // as in a user's own law
    for (const each of this.parts) each.hidden = unknown;
    const limits = [
      ...(isAtLimit(state, tuning.motor_limit) ? ['motor at its limit'] : []),
      ...(state.saturated === 1 && mode === 'acc' ? ['controller at its limit'] : []),
      ...(state.steer_saturated === 1 ? ['steering at its limit'] : []),
    ];
    show(this.limited, limits.join(', '));
    this.limited.hidden = !limits.length;
  }

  /** Show the results of a second run in place of the last and the best lap. */
  compareWith(title, laps) {
    this.other = laps;
    const table = document.querySelector('.laps.acc');
    const [, mine, another] = table.querySelectorAll('th[scope=col]');
    mine.textContent = 'this run';
    another.textContent = 'other run';
    another.title = title;
    for (const cell of table.querySelectorAll(':is(th, td):nth-child(4)')) cell.hidden = true;
    this.shown = null;
  }

  /** Show the results of lap `number`, `laps.current`, beside the one before and the best one. */
  showLaps(laps, number) {
    const shown = JSON.stringify(laps);
    if (shown === this.shown) return;
    this.shown = shown;
    const other = this.other && (this.other.get(number) ?? this.other.latest.current);
    for (const row of this.laps) {
      const { figure, digits, scale } = row.dataset;
      [...row.querySelectorAll('td')].forEach((cell, i) => {
        const value = (other ? [laps.current, other] : [laps.current, laps.last, laps.best])[i]?.[figure];
        show(cell, reading(value == null ? value : value * (scale ?? 1), Number(digits)));
      });
    }
    const named = { last: laps.last, best: laps.best, 'this lap': laps.current };
    const lines = Object.entries(named).filter(([, lap]) => lap?.gains).map(([name, lap]) => `${name}: ${lap.gains}`);
    if (lines.join() === this.named) return;
    this.named = lines.join();
    this.gains.replaceChildren(...lines.map((line) => make('li', {}, line)));
  }

  /** Show how the run went, and what to do next. */
  end({ reason, bag, laps, stretches }, command) {
    const score = laps?.best ?? laps?.current ?? {};
    const onTrack = laps?.table;
    const figures = onTrack ? [
      ['Lap time', score.time, 2, 's'], ['RMS of e_y', score.rms, 3, 'm'],
      ['Maximum of e_y', score.maximum, 3, 'm'], ['Steering at its limit', 100 * score.at_limit, 1, '%'],
    ] : [
      ['RMS error', score.rms, 3, 'm/s'], ['Maximum error', score.maximum, 3, 'm/s'],
      ['Overshoot', score.overshoot == null ? null : 100 * score.overshoot, 1, '%'],
      ['Settling time', score.settling, 2, 's'],
    ];
    const cell = (value, digits) => make('td', {}, reading(value, digits));
    const known = score.rms != null;
    this.card.replaceChildren(
      make('h2', { id: 'end-heading' }, reason),
      ...(known ? [
        ...(laps.count > 1 ? [make('p', {}, `Lap ${score.number + 1}, the best of ${laps.count}:`)] : []),
        make('dl', {}, ...figures.map(([name, value, digits, unit]) => make(
          'div', {}, make('dt', {}, name), make('dd', {}, `${reading(value, digits)} ${unit}`),
        ))),
        ...(onTrack ? [] : [make(
          'table', {},
          make('thead', {}, make('tr', {}, ...[
            ['From', 'm'], ['Grade', '°'], ['RMS', 'm/s'], ['Maximum', 'm/s'],
          ].map(([name, unit]) => make('th', { scope: 'col' }, `${name} `, make('small', {}, unit))))),
          make('tbody', {}, ...stretches.map((stretch) => make(
            'tr', {}, cell(stretch.start, 0), cell(stretch.theta_deg, 0),
            cell(stretch.rms_error, 3), cell(stretch.max_error, 3),
          ))),
        )]),
      ] : []),
      make('details', { className: 'next' }, make('summary', {}, 'Commands'), ...[
        ['Copy command', command],
        ...(bag ? [
          ['Plot', `barc plot ${quote(bag)}`], ['Report', `barc report ${quote(bag)}`],
          ['Replay here', `barc replay ${quote(bag)}`],
        ] : []),
      ].map(([name, text]) => make(
        'p', {}, make('button', {
          type: 'button',
          onclick: async (event) => {
            const button = event.currentTarget;
            show(button, (await copy(text)) ? 'Copied' : 'Copy by hand');
            setTimeout(() => show(button, name), 2000);
          },
        }, name), make('code', {}, text),
      ))),
    );
    this.card.hidden = false;
  }
}

