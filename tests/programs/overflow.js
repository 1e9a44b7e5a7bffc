// Returns what is wider than the page, leaves its panel or is cut, by name.
(() => {
  const found = [];
  const name = (e) => e.id || e.className || e.tagName;
  const page = document.documentElement;
  if (page.scrollWidth > page.clientWidth) found.push('the page');
  for (const e of document.querySelectorAll('body *')) {
    const box = e.getBoundingClientRect();
    if (!e.checkVisibility() || !box.width) continue;
    const beyond = box.left < -0.5 || box.right > page.clientWidth + 0.5;
    if (beyond) found.push(`${name(e)} beyond the page`);
    const panel = e.parentElement.closest('.panel, header')?.getBoundingClientRect();
    if (panel && (box.right > panel.right + 1 || box.bottom > panel.bottom + 1)) {
      found.push(`${name(e)} beyond its panel`);
    }
    const hides = getComputedStyle(e).overflow !== 'visible' && e.tagName !== 'INPUT';
    if (hides && e.scrollWidth > e.clientWidth + 1) found.push(`${name(e)} is cut`);
  }
  return found;
})()
