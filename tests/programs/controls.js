// Counts the controls, and watches which of them show the focus and react to a key.
(() => {
  const controls = Array.from(document.querySelectorAll('a, button, input, select, summary'))
    .filter((e) => e.checkVisibility() && !e.disabled);
  const seen = new Set();
  for (const type of window.used ? [] : ['click', 'input']) {
    addEventListener(type, (event) => {
      used.add(event.target);
      event.preventDefault();
      event.stopImmediatePropagation();
    }, true);
  }
  window.used = new Set();
  window.focused = () => {
    const e = document.activeElement;
    if (getComputedStyle(e).outlineStyle === 'solid') seen.add(e);
    return e.tagName === 'INPUT' ? e.type : e.tagName;
  };
  window.unused = () => controls.filter((e) => !seen.has(e) || !used.has(e))
    .map((e) => e.id || e.textContent);
  document.activeElement.blur();
  return controls.length;
})()
