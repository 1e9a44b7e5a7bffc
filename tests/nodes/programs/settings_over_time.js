// Returns settings at several times, also after time went back.
import('./settings.js').then(({ Settings }) => {
  const settings = new Settings();
  const none = settings.at(1).limit ?? null;
  settings.add(-Infinity, { limit: 0 });
  settings.add(2, { limit: 6 });
  settings.add(5, { limit: 7 });
  const before = [1, 2, 4.9, 5, 9].map((t) => settings.at(t).limit);
  settings.add(3, { limit: 8 }); // time went back
  return [none, before, settings.at(9).limit, settings.at(2.5).limit];
})
