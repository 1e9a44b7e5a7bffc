// Colours, sharp canvases, simple shapes, and the format of numbers.

const names = [
  'panel', 'line', 'grid', 'ink', 'muted', 'blue', 'sky', 'green', 'orange', 'purple',
  'vermillion', 'brown', 'air-high', 'air-low', 'earth', 'surface', 'ground', 'ground-line',
  'ground-strong', 'slope', 'term-0', 'term-1', 'term-2', 'term-3',
];

/** The name in the palette of each quantity's colour; the terms have theirs in their order. */
export const QUANTITIES = {
  speed: 'blue', absolute_speed: 'blue', measured_speed: 'sky', reference: 'ink',
  motor: 'green', acting: 'green', servo: 'green', e_y: 'blue', e_psi: 'blue',
  gravity: 'muted', drag: 'muted', friction: 'muted', // named beside their arrows
};
/** Degrees in a radian: all angles of the page are shown in degrees. */
export const DEGREES = 180 / Math.PI;
export const termColour = (i) => `term-${i % 4}`;

export const colours = {};

const probe = document.createElement('i');
probe.hidden = true;
probe.className = 'probe';

function readColours() {
  document.documentElement.append(probe);
  for (const name of names) {
    probe.style.color = `var(--${name})`;
    colours[name] = getComputedStyle(probe).color;
  }
  probe.remove();
}

/** Read the colours now; return a function that reads them again and calls `changed`. */
export function watchColours(changed) {
  const read = () => {
    readColours();
    changed();
  };
  read();
  for (const query of ['(prefers-color-scheme: dark)', '(forced-colors: active)']) {
    matchMedia(query).addEventListener('change', read);
  }
  return read;
}

const still = matchMedia('(prefers-reduced-motion: reduce)');

/** Return the share of a change to show in this frame; 1 if the user prefers reduced motion. */
export const ease = (share) => (still.matches ? 1 : share);

export const font = (size, weight = 400) =>
  `${weight} ${size}px system-ui, -apple-system, "Segoe UI", Roboto, "Noto Sans", "DejaVu Sans", sans-serif`;

/** A canvas whose resolution follows its size on the page; `begin` clears it. */
export class Surface {
  constructor(canvas, changed) {
    this.canvas = canvas;
    this.context = canvas.getContext('2d');
    this.width = this.height = 0;
    this.isOnPaper = false;
    new ResizeObserver(() => {
      if (!this.isOnPaper) this.#measure();
      changed();
    }).observe(canvas);
  }

  /** Use a size [px] for paper, whose own size is not known before it is printed. */
  putOnPaper(width, height) {
    this.isOnPaper = true;
    this.width = width;
    this.height = height;
  }

  /** Follow the size on the page again. */
  putOnScreen() {
    this.isOnPaper = false;
    this.#measure();
  }

  #measure() {
    const box = this.canvas.getBoundingClientRect();
    this.width = box.width;
    this.height = box.height;
  }

  begin() {
    const ratio = devicePixelRatio;
    const [width, height] = [Math.round(this.width * ratio), Math.round(this.height * ratio)];
    if (this.canvas.width !== width || this.canvas.height !== height) {
      this.canvas.width = width;
      this.canvas.height = height;
    }
    this.context.setTransform(ratio, 0, 0, ratio, 0, 0);
    this.context.clearRect(0, 0, this.width, this.height);
    return this.context;
  }
}

/** Draw a line through points. */
export function stroke(context, ...points) {
  context.beginPath();
  for (const point of points) context.lineTo(...point);
  context.stroke();
}

/** Fill the shape between points, in the present colour unless another is given. */
export function fill(context, points, colour = context.fillStyle) {
  context.beginPath();
  for (const point of points) context.lineTo(...point);
  context.fillStyle = colour;
  context.fill();
}

/** Begin a circle, to be filled or drawn. */
export function circle(context, x, y, radius) {
  context.beginPath();
  context.arc(x, y, radius, 0, 2 * Math.PI);
}

/** Return `value` with `digits` decimals; a dash if unknown, and no negative zero. */
export function reading(value, digits) {
  if (value === null || value === undefined || Number.isNaN(value)) return '–';
  const text = value.toFixed(digits);
  return (Number(text) === 0 ? text.replace('-', '') : text).replace('-', '−');
}

/** Set an element's text, if it differs. */
export function show(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

/** Return a new element with properties and children. */
export function make(tag, properties = {}, ...children) {
  const element = Object.assign(document.createElement(tag), properties);
  element.append(...children);
  return element;
}

/** Offer a file for download. */
export function save(name, blob) {
  const link = make('a', { href: URL.createObjectURL(blob), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

/** Return a word, quoted for a shell if needed. */
export const quote = (text) => (/^[\w@%+=:,./-]+$/.test(text) ? text : `'${text.replaceAll("'", "'\\''")}'`);

/** Copy a text; return whether that was possible. */
export async function copy(text) {
  try {
    await navigator.clipboard.writeText(text);
    return true;
  } catch { // plain http from another machine has no clipboard
    const area = make('textarea', { value: text });
    document.body.append(area);
    area.select();
    const done = document.execCommand('copy');
    area.remove();
    return done;
  }
}

/** Return a step of 1, 2 or 5 times a power of ten that divides `span` in about `count`. */
export function niceStep(span, count) {
  const rough = span / count;
  const power = 10 ** Math.floor(Math.log10(rough));
  return power * ([1, 2, 5, 10].find((factor) => factor * power >= rough) ?? 10);
}
