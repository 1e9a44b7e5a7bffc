// Returns the texts that are drawn across the border of a canvas in a moment.
new Promise((done) => {
  const cut = new Set();
  const { fillText } = CanvasRenderingContext2D.prototype;
  CanvasRenderingContext2D.prototype.fillText = function (text, x, y, ...more) {
    const { width, height } = this.canvas;
    const box = this.measureText(text);
    for (const u of [x - box.actualBoundingBoxLeft, x + box.actualBoundingBoxRight]) {
      for (const v of [y - box.actualBoundingBoxAscent, y + box.actualBoundingBoxDescent]) {
        const at = this.getTransform().transformPoint(new DOMPoint(u, v));
        if (at.x < -1 || at.y < -1 || at.x > width + 1 || at.y > height + 1) cut.add(text);
      }
    }
    fillText.call(this, text, x, y, ...more);
  };
  setTimeout(() => {
    CanvasRenderingContext2D.prototype.fillText = fillText;
    done([...cut]);
  }, 80);
})
