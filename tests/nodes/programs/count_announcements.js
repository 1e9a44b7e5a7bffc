// Counts, for each region that is read aloud, how often its text changes.
(() => {
  window.announced = [];
  const regions = '[role=status], [role=alert], [aria-live], output';
  for (const region of document.querySelectorAll(regions)) {
    let texts = 0;
    let before = region.textContent;
    new MutationObserver(() => {
      if (region.textContent !== before) texts += 1;
      before = region.textContent;
      announced[region.id] = texts;
    }).observe(region, { childList: true, characterData: true, subtree: true });
  }
})()
