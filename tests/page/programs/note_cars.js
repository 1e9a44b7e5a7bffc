// Notes where cars are drawn from above, by their opacity: place and scale [px], and heading.
(() => {
  window.cars = {};
  const own = CanvasRenderingContext2D.prototype;
  for (const name of ['translate', 'rotate', 'scale']) {
    const call = own[name];
    own[name] = function (...values) {
      if (this.canvas.id === 'scene') (cars[this.globalAlpha] ??= {})[name] ??= values;
      call.apply(this, values);
    };
  }
  const begin = own.clearRect;
  own.clearRect = function (...values) {
    if (this.canvas.id === 'scene') window.cars = {};
    begin.apply(this, values);
  };
})()
