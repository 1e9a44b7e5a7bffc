// A compass, and the front wheels with their steering angle.

import { colours, font } from './look.js';

const TYRE = [0.46, 0.15]; // shares of the radius: length and width

export function drawDial(surface, state) {
  const context = surface.begin();
  if (!state) return;
  const { width, height } = surface;
  const radius = Math.min(width / 4, height / 2) - 6;
  if (radius <= 0) return; // not laid out yet
  drawCompass(context, width / 4, height / 2, radius, state.psi);
  drawAxle(context, (3 * width) / 4, height / 2, radius, Number.isNaN(state.servo) ? 0 : state.servo);
}

/** x points right and y up, as in the picture. */
function drawCompass(context, x, y, radius, heading) {
  context.save();
  context.translate(x, y);
  context.strokeStyle = colours.line;
  context.lineWidth = 2;
  context.beginPath();
  context.arc(0, 0, radius, 0, 2 * Math.PI);
  context.stroke();
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
    context.beginPath();
    context.moveTo(0, -radius);
    context.lineTo(0, -radius + (i % 3 === 2 ? 8 : 5));
    context.stroke();
  }
  context.rotate(Math.PI / 2 - heading);
  context.fillStyle = colours.blue;
  context.beginPath();
  context.moveTo(0, -0.58 * radius);
  context.lineTo(0.26 * radius, 0.4 * radius);
  context.lineTo(0, 0.22 * radius);
  context.lineTo(-0.26 * radius, 0.4 * radius);
  context.closePath();
  context.fill();
  context.restore();
}

function drawAxle(context, x, y, radius, servo) {
  context.save();
  context.translate(x, y);
  context.strokeStyle = colours.line;
  context.lineWidth = 2;
  context.beginPath();
  context.arc(0, 0, radius, 0, 2 * Math.PI);
  context.stroke();
  context.strokeStyle = colours.muted;
  context.lineWidth = 4;
  context.beginPath();
  context.moveTo(-0.5 * radius, 0);
  context.lineTo(0.5 * radius, 0);
  context.stroke();
  context.fillStyle = colours.blue;
  for (const side of [-0.5, 0.5]) {
    context.save();
    context.translate(side * radius, 0);
    context.rotate(-servo);
    context.beginPath();
    context.roundRect(-TYRE[1] * radius, -TYRE[0] * radius, 2 * TYRE[1] * radius, 2 * TYRE[0] * radius, 3);
    context.fill();
    context.restore();
  }
  context.restore();
}
