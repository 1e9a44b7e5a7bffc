// Asks for values of parameters; returns what is sent, shown and noted.
import('./parameters.js').then(async ({ Parameters }) => {
  const sent = [];
  const notes = [];
  const parameters = new Parameters(
    (name, value) => sent.push(value), () => {}, (text) => notes.push(text), 300,
  );
  const shown = [];
  const note = () => shown.push(parameters.shown('kp') ?? null);
  parameters.request('kp', 1);
  note();
  parameters.connect(true);
  parameters.receive({ kp: 0 });
  note();
  parameters.request('kp', 1);
  parameters.request('kp', 2);
  note();
  parameters.receive({ kp: 0.5 });
  note();
  parameters.accept('kp', 1);
  note();
  while (sent.length < 2) await new Promise((done) => { setTimeout(done, 5); });
  parameters.refuse('kp', 'why');
  while (parameters.requests.size) await new Promise((done) => { setTimeout(done, 5); });
  note();
  parameters.request('kp', 3);
  note();
  while (parameters.requests.size) await new Promise((done) => { setTimeout(done, 5); });
  note();
  parameters.request('kp', 4);
  parameters.connect(false);
  note();
  return { sent, shown, notes: notes.filter((text) => text) };
})
