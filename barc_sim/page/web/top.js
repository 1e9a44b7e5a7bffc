// The car from above, to scale, on a grid that scrolls; x is to the right, y up, as in figures.

import {
  colours, ease, fill, font, niceStep, reading, stroke,
} from './look.js';

const LENGTH = 4.5; // [m]
const WIDTH = 1.9;
const TYRE = [0.7, 0.28]; // [m] length and width
const TRACK = 0.9; // [m] from the middle to a wheel
const PATH = 30000; // rows of the path that are drawn
const BODY = '#003F74';
const INK = '#222222';

export class TopView {
  constructor() {
    this.span = NaN; // [m] across the shorter side
  }

  /** `ghost`: a pale car; `track`, how far ahead [m] the steering aims, and the path that it plans. */
  draw(surface, history, axles, state, goal, ghost, track = null, aim = 0, plan = []) {
    const context = surface.begin();
    const { width, height } = surface;
    context.fillStyle = colours.ground;
    context.fillRect(0, 0, width, height);
    if (!state) return;
    const wanted = (goal.on || track ? 36 : 20) + 0.7 * Math.min(Math.abs(state.speed), 60);
    this.span = Number.isNaN(this.span) ? wanted : this.span + ease(0.04) * (wanted - this.span);
    const scale = Math.min(width, height) / this.span;
    const toScreen = (x, y) => [
      width / 2 + (x - state.x) * scale, height / 2 - (y - state.y) * scale,
    ];
    drawGrid(context, width, height, scale, state, toScreen);
    track?.draw(context, toScreen);
    drawPath(context, history, state, toScreen);
    if (track && aim) track.drawAim(context, toScreen, state, aim);
    context.strokeStyle = colours.vermillion;
    context.lineWidth = 3;
    if (track) stroke(context, ...plan.map((point) => toScreen(...point)));
    if (!track) goal.draw(surface, scale, toScreen);
    for (const [car, alpha] of [[ghost, 0.35], [state, 1]]) {
      if (!car) continue;
      context.save();
      context.globalAlpha = alpha;
      context.translate(...toScreen(car.x, car.y));
      context.rotate(-car.psi);
      context.scale(scale, -scale);
      drawCar(context, axles, Number.isNaN(car.servo) ? 0 : car.servo, scale);
      context.restore();
    }
    drawScaleBar(context, scale);
    track?.drawMap(surface, [[ghost, 0.4], [state, 1]]);
  }
}

function drawGrid(context, width, height, scale, state, toScreen) {
  const step = Math.max(niceStep(60 / scale, 1), 1);
  const [alongX, alongY] = [width / 2 / scale, height / 2 / scale];
  context.font = font(12);
  context.fillStyle = colours.muted;
  const each = (from, to, draw) => {
    for (let i = Math.ceil(from / step); i * step <= to; i += 1) {
      context.strokeStyle = i % 5 === 0 ? colours['ground-strong'] : colours['ground-line'];
      context.lineWidth = i === 0 ? 2 : 1;
      draw(i * step, i % 5 === 0);
    }
  };
  each(state.x - alongX, state.x + alongX, (x, strong) => {
    const [u] = toScreen(x, 0);
    stroke(context, [u, 0], [u, height]);
    context.textAlign = 'left';
    context.textBaseline = 'top';
    if (strong && u > 240 && u < width - 60) context.fillText(`x ${reading(x, 0)} m`, u + 5, 8);
  });
  each(state.y - alongY, state.y + alongY, (y, strong) => {
    const [, v] = toScreen(0, y);
    stroke(context, [0, v], [width, v]);
    context.textAlign = 'left';
    context.textBaseline = 'bottom';
    if (strong && v > 70) context.fillText(`y ${reading(y, 0)} m`, 8, v - 3);
  });
}

function drawPath(context, history, state, toScreen) {
  context.strokeStyle = colours.blue;
  context.globalAlpha = 0.75;
  context.lineWidth = 2.5;
  context.lineJoin = 'round';
  context.beginPath();
  let pen = false;
  let [lastX, lastY] = [NaN, NaN];
  const end = history.row(state.t);
  for (let row = Math.max(0, end - PATH); row <= end; row += 1) {
    const [x, y] = [history.at(row, 'x'), history.at(row, 'y')];
    const jumps = row < end && history.jumps(row) && !history.goesOn(row);
    if (pen && !jumps && Math.hypot(x - lastX, y - lastY) < 0.25) continue;
    if (pen) context.lineTo(...toScreen(x, y));
    else context.moveTo(...toScreen(x, y));
    pen = !jumps;
    [lastX, lastY] = [x, y];
  }
  if (pen) context.lineTo(...toScreen(state.x, state.y));
  context.stroke();
  context.globalAlpha = 1;
}

/** Draw in metres from the centre of mass, x forward, y to the left. */
function drawCar(context, axles, servo, scale) {
  const middle = (axles[0] + axles[1]) / 2;
  const box = (x, y, length, width, radius, colour) => {
    context.beginPath();
    context.roundRect(x - length / 2, y - width / 2, length, width, radius);
    context.fillStyle = colour;
    context.fill();
  };
  box(middle - 0.08, -0.1, LENGTH + 0.2, WIDTH + 0.2, 0.6, 'rgb(0 0 0 / 0.16)');
  for (const [axle, angle] of [[axles[0], 0], [axles[1], servo]]) {
    for (const side of [TRACK, -TRACK]) {
      context.save();
      context.translate(axle, side);
      context.rotate(angle);
      box(0, 0, TYRE[0], TYRE[1], 0.07, INK);
      context.strokeStyle = colours.muted;
      context.lineWidth = 1 / scale;
      context.stroke();
      context.restore();
    }
  }
  context.save();
  context.translate(middle, 0);
  context.lineWidth = 1.2 / scale;
  context.strokeStyle = INK;
  context.beginPath();
  context.moveTo(-2.1, 0.78);
  context.bezierCurveTo(-2.3, 0.72, -2.3, -0.72, -2.1, -0.78);
  context.bezierCurveTo(-1.2, -0.88, -0.2, -0.9, 0.5, -0.86);
  context.bezierCurveTo(1.1, -0.78, 1.7, -0.76, 2.0, -0.66);
  context.bezierCurveTo(2.34, -0.5, 2.34, 0.5, 2.0, 0.66);
  context.bezierCurveTo(1.7, 0.76, 1.1, 0.78, 0.5, 0.86);
  context.bezierCurveTo(-0.2, 0.9, -1.2, 0.88, -2.1, 0.78);
  context.fillStyle = BODY;
  context.fill();
  context.stroke();
  fill(context, [[0.95, 0.62], [0.4, 0.54], [0.4, -0.54], [0.95, -0.62], [1.08, 0]], '#dcebf4');
  fill(context, [[-1.55, 0.55], [-1.2, 0.5], [-1.2, -0.5], [-1.55, -0.55], [-1.62, 0]], '#dcebf4');
  fill(context, [[0.22, 0.6], [-1.05, 0.6], [-1.2, 0.72], [0.5, 0.74]], '#dcebf4');
  fill(context, [[0.22, -0.6], [-1.05, -0.6], [-1.2, -0.72], [0.5, -0.74]], '#dcebf4');
  for (const side of [1, -1]) {
    fill(context, [[2.0, 0.68 * side], [2.2, 0.48 * side], [2.22, 0.3 * side], [2.05, 0.44 * side]], '#f0e442');
    fill(context, [[-2.2, 0.66 * side], [-2.24, 0.38 * side], [-2.14, 0.38 * side], [-2.1, 0.66 * side]], '#d55e00');
  }
  context.restore();
}

function drawScaleBar(context, scale) {
  const metres = niceStep(50 / scale, 1);
  const [x, y] = [16, 22];
  context.fillStyle = colours.panel;
  context.globalAlpha = 0.85;
  context.fillRect(x - 8, y - 18, metres * scale + 16, 32);
  context.globalAlpha = 1;
  context.strokeStyle = colours.ink;
  context.lineWidth = 2;
  const right = x + metres * scale;
  stroke(context, [x, y], [x, y + 6], [right, y + 6], [right, y]);
  context.font = font(12, 600);
  context.fillStyle = colours.ink;
  context.textAlign = 'center';
  context.textBaseline = 'bottom';
  context.fillText(`${metres} m`, x + (metres * scale) / 2, y + 2);
}
