// The page: keeps the states that arrive, and draws them at the display's rate.

import { Chart } from './chart.js';
import { Clock } from './clock.js';
import { Connection } from './connection.js';
import { drawDial } from './dial.js';
import { Driving } from './drive.js';
import { History } from './history.js';
import { reading, Surface, watchColours } from './look.js';
import { Player } from './player.js';
import { Road } from './road.js';
import { drawCourse, drawSide } from './side.js';
import { TopView } from './top.js';
import { Tuning } from './tuning.js';

const TITLES = { acc: 'cruise control', teleop: 'teleoperation' };
const CHART_PERIOD = 0.033; // [s] between two drawings of the charts
const HINT = 'Arrows or WASD drive, R\u00a0resets, P\u00a0pauses.';

const element = (id) => document.getElementById(id);
const history = new History();
const clock = new Clock();
const top = new TopView();
let facts = { mode: 'acc', axles: [-1.5, 1.5], road: null };
let road = new Road(null);
let paused = false;
let ended = false;
let drawn = {}; // the last drawing
let message_timer = null;

const stale = () => { drawn = {}; };
const surface = (id) => new Surface(element(id), stale);
const [scene, course, dial] = ['scene', 'course', 'dial'].map(surface);
const speedChart = new Chart(surface('speed-chart'), [
  { column: 'reference', colour: 'ink', width: 1.5, dash: [6, 4] },
  { column: 'speed', colour: 'blue', width: 2.5 },
], 1, [-150, 150]);
const COMMAND = { column: 'motor', colour: 'green', width: 2.5 };
const TERM_COLOURS = ['orange', 'sky', 'purple', 'ink'];
const commandChart = new Chart(surface('command-chart'), [COMMAND], 4, [-10, 10]);
watchColours(stale);

/** Draw the controller's terms below its command, and name them in the legend. */
function showTerms(terms) {
  const lines = terms.map((column, i) => (
    { column, colour: TERM_COLOURS[i % TERM_COLOURS.length], width: 1.5 }
  ));
  commandChart.lines = [...[...lines].reverse(), COMMAND];
  element('terms').replaceChildren(element('terms').firstElementChild, ...lines.map((line) => (
    Object.assign(document.createElement('li'), {
      className: `acc line-${line.colour}`, textContent: line.column,
    })
  )));
}

function setState(state, text) {
  element('state').dataset.state = state;
  if (element('state-text').textContent !== text) element('state-text').textContent = text;
}

/** Show a message, for some seconds or until the next one. */
function showMessage(text, seconds = 0) {
  clearTimeout(message_timer);
  element('message').textContent = text;
  element('message').hidden = !text;
  if (text && seconds) message_timer = setTimeout(() => showMessage(''), 1000 * seconds);
}

const player = new Player(history);
const connection = new Connection({
  hello(fields) {
    history.name(fields.columns, fields.continues);
    clock.restart();
    road = new Road(fields.road);
    showMessage('');
    setState('live', 'Live');
    this.facts(fields);
    document.body.toggleAttribute('data-replay', 'replay' in fields);
    if (fields.replay) player.begin(fields.replay);
  },
  facts(fields) {
    const known = JSON.stringify(fields.road) === JSON.stringify(facts.road);
    facts = fields;
    if (!known) road = new Road(fields.road);
    document.body.dataset.mode = fields.mode;
    const title = fields.replay?.title ?? TITLES[fields.mode];
    element('title').textContent = title;
    document.title = `${title} – barc_sim`;
    tuning.show(fields.sliders, fields.tuning);
    showTerms(fields.terms);
    stale();
  },
  rows(rows) {
    history.add(rows);
    if (facts.replay) player.loaded();
  },
  status(status) {
    paused = status.paused;
    element('factor').textContent = reading(status.factor, 2);
    element('missed').textContent = status.missed ?? '–';
    element('missed-fact').classList.toggle('bad', status.missed > 0);
    element('pause').setAttribute('aria-pressed', paused);
    element('pause').textContent = paused ? 'Resume' : 'Pause';
    element('driver').textContent = status.driver === 'other' ? 'Another page is driving.' : HINT;
    if (paused) setState('paused', 'Paused');
    else setState('live', 'Live');
  },
  refused({ what, why }) {
    if (what === 'drive') showMessage('Another page is driving. You can drive once it has been idle for 3 s.', 4);
    else if (what === 'reset' || what === 'pause') showMessage(`Cannot ${what}: ${why}.`, 6);
    else tuning.refuse(what, why);
  },
  end({ reason }) {
    ended = true;
    setState('ended', 'Ended');
    showMessage(reason);
    for (const button of document.querySelectorAll('.actions button')) button.disabled = true;
  },
  lost() {
    setState('lost', 'Reconnecting');
    showMessage('The connection to the run was lost. This page reconnects by itself.');
  },
  moved() {
    setState('lost', 'Another run');
    showMessage('Another run serves this port now: open the address that it printed.');
  },
  next() {
    showMessage('The next run has started at this address.');
    element('message').append(' ', Object.assign(document.createElement('button'), {
      type: 'button', textContent: 'Open it', onclick: () => location.reload(),
    }));
  },
  closed(reason) {
    setState('refused', 'Disconnected');
    showMessage(`The run closed this connection (${reason}). Reload the page to try again.`);
  },
});
const tuning = new Tuning((name, value) => connection.send('tune', { name, value }));
const reset = () => connection.send('reset');
const pause = () => connection.send('pause', { on: !paused });
element('reset').addEventListener('click', reset);
element('pause').addEventListener('click', pause);
new Driving(
  (linear, angular, brake) => connection.send('drive', { linear, angular, brake }),
  () => facts.mode === 'teleop' && !facts.replay && !ended,
  { KeyR: reset, KeyP: pause },
);

const degrees = (radians) => (radians * 180) / Math.PI;

function showReadings(state) {
  const texts = {
    time: reading(state.t, 1),
    speed: reading(state.speed, 2),
    reference: reading(state.reference, 2),
    error: reading(state.reference - state.speed, 2),
    position: reading(state.x, 1),
    grade: reading(state.theta_deg, 0),
    heading: reading(((degrees(state.psi) % 360) + 540) % 360 - 180, 0),
    steering: reading(degrees(state.servo), 1),
    place: `${reading(state.x, 1)}, ${reading(state.y, 1)}`,
    command: reading(state.motor, 2),
  };
  for (const [id, text] of Object.entries(texts)) {
    if (element(id).textContent !== text) element(id).textContent = text;
  }
}

function draw(milliseconds) {
  requestAnimationFrame(draw);
  const now = milliseconds / 1000;
  const newest = history.last('t');
  const time = facts.replay ? player.advance(now) : clock.advance(now, newest);
  const state = history.state(time);
  if (state) road.learn(state);
  if (drawn.time === time && drawn.count === history.count && drawn.settled) return;
  const charts = !(now - drawn.charts < CHART_PERIOD);
  if (facts.mode === 'teleop') {
    top.draw(scene, history, facts.axles, state);
  } else {
    drawSide(scene, road, facts.axles, state);
  }
  if (charts) {
    if (facts.mode === 'acc') drawCourse(course, road, state);
    else drawDial(dial, state);
    speedChart.draw(history, state);
    commandChart.draw(history, state);
    if (state) showReadings(state);
  }
  // The camera moves on for a while after the last state.
  const still = drawn.time === time ? (drawn.still ?? 0) + 1 : 0;
  drawn = {
    time, count: history.count, still, settled: still > 60 && charts, charts: charts ? now : drawn.charts,
  };
}
requestAnimationFrame(draw);
