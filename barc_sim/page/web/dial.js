// A compass, and the front wheels with their steering angle.

import { circle, colours, fill, font, stroke } from './look.js';

const TYRE = [0.46, 0.15]; // shares of the radius: length and width

export function drawDial(surface, state) {
  const context = surface.begin();
  if (!state) return;
  const { width, height } = surface;
  const radius = Math.min(width / 4, height / 2) - 6;
  if (radius <= 0) return; // not laid out yet
  context.translate(width / 4, height / 2);
  for (const draw of [drawCompass, drawAxle]) {
    context.save();
    context.strokeStyle = colours.line;
    context.lineWidth = 2;
    circle(context, 0, 0, radius);
    context.stroke();
    draw(context, radius, state);
    context.restore();
    context.translate(width / 2, 0);
  }
}

/** x points right and y up, as in the picture. */
function drawCompass(context, radius, { psi }) {
  context.font = font(12, 600);
  context.fillStyle = colours.muted;
  context.textAlign = 'center';
  context.textBaseline = 'middle';
  [['x', 1, 0], ['y', 0, -1]].forEach(([name, u, v]) => {
    context.fillText(name, 0.76 * radius * u, 0.76 * radius * v);
  });
  context.strokeStyle = colours.muted;
  context.lineWidth = 1.5;
  for (let i = 0; i < 12; i += 1) {
    context.rotate(Math.PI / 6);
    stroke(context, [0, -radius], [0, -radius + (i % 3 === 2 ? 8 : 5)]);
  }
  context.rotate(Math.PI / 2 - psi);
  context.scale(radius, radius);
  fill(context, [[0, -0.58], [0.26, 0.4], [0, 0.22], [-0.26, 0.4]], colours.blue);
}

function drawAxle(context, radius, { servo }) {
  context.strokeStyle = colours.muted;
  context.lineWidth = 4;
  stroke(context, [-0.5 * radius, 0], [0.5 * radius, 0]);
  context.fillStyle = colours.blue;
  for (const side of [-0.5, 0.5]) {
    context.save();
    context.translate(side * radius, 0);
    context.rotate(Number.isNaN(servo) ? 0 : -servo);
    context.beginPath();
    context.roundRect(-TYRE[1] * radius, -TYRE[0] * radius, 2 * TYRE[1] * radius, 2 * TYRE[0] * radius, 3);
    context.fill();
    context.restore();
  }
}
