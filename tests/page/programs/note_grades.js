// Notes how far below the part of a chart that is left to its lines each grade is written [px].
(() => {
  window.names = [];
  const { fillText, rect } = CanvasRenderingContext2D.prototype;
  const ends = {};
  Object.assign(CanvasRenderingContext2D.prototype, {
    rect(x, y, width, height) {
      ends[this.canvas.id] = y + height;
      rect.call(this, x, y, width, height);
    },
    fillText(text, x, y) {
      const end = ends[this.canvas.id];
      const { actualBoundingBoxAscent: ascent } = this.measureText(text);
      if (end && text.endsWith('°')) names.push(y - ascent - end);
      fillText.call(this, text, x, y);
    },
  });
})()
