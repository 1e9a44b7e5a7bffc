// Keys and two thumb pads as driving commands.

const KEYS = {
  ArrowUp: 'forward', KeyW: 'forward', ArrowDown: 'back', KeyS: 'back',
  ArrowLeft: 'left', KeyA: 'left', ArrowRight: 'right', KeyD: 'right', Space: 'stop',
};
const MINIMUM = 20; // [ms] between two messages while a thumb moves
const REPEAT = 50; // [ms] between two messages while something is held
const DEAD = 0.12; // share of a pad's radius that counts as its middle

const CONTROLS = 'a, button, input, select, textarea, summary, [tabindex]';

/** Return whether a key belongs to the control that has the focus, not to the page. */
export const isForControl = (event) => event.target instanceof Element && event.target.closest(CONTROLS) !== null;

/** Return whether a key is the focused control's: a button uses the space bar, and no arrow. */
const isUsed = (event) => (event.code in KEYS && event.code !== 'Space'
  ? event.target instanceof Element && event.target.closest('input, select, textarea') !== null
  : isForControl(event));

const clip = (value) => Math.min(Math.max(value, -1), 1);

export class Driving {
  /**
   * `send` takes forward and turn, from -1 to 1, and the brake, from 0 to 1. `enabled` returns
   * whether keys and pads drive now. While a control has the focus, the keys belong to it.
   */
  constructor(send, enabled, commands) {
    this.send = send;
    this.enabled = enabled;
    this.pressed = new Map(); // event code -> action
    this.pads = { steer: 0, throttle: 0 };
    this.moving = false;
    this.sent = 0; // [ms] when a thumb's place was last sent
    this.#listen(commands);
    for (const name of Object.keys(this.pads)) this.#listenToPad(name);
    for (const cap of document.querySelectorAll('kbd')) this.#listenToCap(cap);
    setInterval(() => this.moving && this.#update(), REPEAT);
  }

  /** Release all keys and pads; if any was held, brake by a share from 0 to 1. */
  release(brake = 0) {
    this.pressed.clear();
    this.pads = { steer: 0, throttle: 0 };
    for (const pad of document.querySelectorAll('.pad')) rest(pad);
    if (this.moving && brake) {
      this.send(0, 0, brake);
      this.moving = false;
    }
    this.#update();
  }

  #listen(commands) {
    addEventListener('keydown', (event) => {
      if (event.ctrlKey || event.altKey || event.metaKey || !this.enabled()) return;
      if (event.code === 'Escape') document.activeElement?.blur(); // keys drive again
      if (isUsed(event)) return;
      const action = KEYS[event.code];
      if (action) {
        event.preventDefault();
        if (!event.repeat) {
          this.pressed.set(event.code, action);
          this.#update();
        }
      } else if (!event.repeat && commands[event.code]) {
        commands[event.code]();
      }
    });
    addEventListener('keyup', (event) => {
      if (this.pressed.delete(event.code)) this.#update();
    });
    // A key pressed before the focus moved to a control is released.
    addEventListener('focusin', (event) => isForControl(event) && this.release());
    addEventListener('blur', () => this.release());
    // A button pressed with the mouse gives the keys back.
    addEventListener('click', (event) => {
      const button = event.target.closest?.('button');
      if (event.detail > 0 && button && this.enabled()) button.blur();
    });
    addEventListener('pagehide', () => this.release(1)); // the page is closed or hidden
    document.addEventListener('visibilitychange', () => document.hidden && this.release(1));
  }

  #listenToPad(name) {
    const pad = document.getElementById(name);
    const follow = (event) => {
      if (!pad.hasPointerCapture(event.pointerId) || !pad.classList.contains('held')) return;
      const box = pad.getBoundingClientRect();
      const [x, y] = [
        clip((event.clientX - box.left - box.width / 2) / (0.4 * box.width)),
        clip((event.clientY - box.top - box.height / 2) / (0.4 * box.height)),
      ];
      const held = name === 'steer' ? -x : -y;
      this.pads[name] = Math.abs(held) < DEAD ? 0 : held;
      const knob = pad.querySelector('i');
      knob.style.transform = name === 'steer'
        ? `translateX(${0.34 * box.width * x}px)` : `translateY(${0.34 * box.height * y}px)`;
      if (event.timeStamp - this.sent < MINIMUM) {
        this.moving = true; // the repeat sends the present place
        return;
      }
      this.sent = event.timeStamp;
      this.#update();
    };
    const release = () => {
      this.pads[name] = 0;
      rest(pad);
      this.#update();
    };
    pad.addEventListener('pointerdown', (event) => {
      event.preventDefault();
      if (!this.enabled()) return;
      pad.setPointerCapture(event.pointerId);
      pad.classList.add('held');
      follow(event);
    });
    pad.addEventListener('pointermove', follow);
    pad.addEventListener('lostpointercapture', release);
  }

  /** Hold a key while its cap is pressed, by a finger or the mouse. */
  #listenToCap(cap) {
    cap.addEventListener('pointerdown', (event) => {
      event.preventDefault();
      if (!this.enabled()) return;
      cap.setPointerCapture(event.pointerId);
      this.pressed.set(cap, cap.dataset.held);
      this.#update();
    });
    cap.addEventListener('lostpointercapture', () => {
      if (this.pressed.delete(cap)) this.#update();
    });
  }

  #update() {
    const held = new Set(this.pressed.values());
    for (const cap of document.querySelectorAll('kbd')) {
      cap.classList.toggle('held', held.has(cap.dataset.held));
    }
    const forward = clip(held.has('forward') - held.has('back') + this.pads.throttle);
    const turn = clip(held.has('left') - held.has('right') + this.pads.steer);
    const moving = held.size > 0 || forward !== 0 || turn !== 0;
    if (held.has('stop')) this.send(0, 0, 1);
    else if (moving || this.moving) this.send(forward, turn, 0);
    this.moving = moving;
  }
}

function rest(pad) {
  pad.classList.remove('held');
  pad.querySelector('i').style.transform = '';
}
