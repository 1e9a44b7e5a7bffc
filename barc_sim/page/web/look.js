// Colours, sharp canvases, and the format of numbers.

const names = [
  'panel', 'line', 'grid', 'ink', 'muted', 'blue', 'sky', 'green', 'orange', 'purple',
  'vermillion', 'air-high', 'air-low', 'earth', 'surface', 'ground', 'ground-line',
  'ground-strong',
];

export const colours = {};

function readColours() {
  const style = getComputedStyle(document.documentElement);
  for (const name of names) colours[name] = style.getPropertyValue(`--${name}`).trim();
}

/** Read the colours now; when light becomes dark, read them again and call `changed`. */
export function watchColours(changed) {
  readColours();
  matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => {
    readColours();
    changed();
  });
}

export const font = (size, weight = 400) =>
  `${weight} ${size}px system-ui, -apple-system, "Segoe UI", Roboto, "Noto Sans", "DejaVu Sans", sans-serif`;

/** A canvas whose resolution follows its size on the page; `begin` clears it. */
export class Surface {
  constructor(canvas, changed) {
    this.canvas = canvas;
    this.context = canvas.getContext('2d');
    this.width = this.height = 0;
    new ResizeObserver(() => {
      const box = canvas.getBoundingClientRect();
      this.width = box.width;
      this.height = box.height;
      changed();
    }).observe(canvas);
  }

  begin() {
    const ratio = devicePixelRatio || 1;
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

/** Return `value` with so many decimals; a dash if unknown, and no negative zero. */
export function reading(value, digits) {
  if (value === null || value === undefined || Number.isNaN(value)) return '–';
  const text = value.toFixed(digits);
  return (Number(text) === 0 ? text.replace('-', '') : text).replace('-', '−');
}

/** Return a step of 1, 2 or 5 times a power of ten that divides `span` in about `count`. */
export function niceStep(span, count) {
  const rough = span / count;
  const power = 10 ** Math.floor(Math.log10(rough));
  return power * ([1, 2, 5, 10].find((factor) => factor * power >= rough) ?? 10);
}
