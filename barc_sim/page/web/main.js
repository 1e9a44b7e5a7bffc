// The page: keeps the states that arrive, and draws them at the display's rate.

import { Chart } from './chart.js';
import { Clock } from './clock.js';
import { Connection } from './connection.js';
import { Driving } from './drive.js';
import { Explorer } from './explorer.js';
import { Goal } from './goal.js';
import { History } from './history.js';
import { Laps } from './laps.js';
import { Lesson } from './lesson.js';
import {
  copy, DEGREES, make, QUANTITIES, reading, show, Surface, termColour, watchColours,
} from './look.js';
import { Player } from './player.js';
import { Road } from './road.js';
import { Settings } from './settings.js';
import { drawCourse, drawSide } from './side.js';
import { TopView } from './top.js';
import { aimOf, showTrackLaps, Track } from './track.js';
import { Tuning } from './tuning.js';

const TITLES = { acc: 'cruise control', teleop: 'teleoperation', track: 'lane keeping' };
const HEADINGS = {
  track: [['Error e_y', 'm'], ['Error e_psi', '°']],
  else: [['Speed', 'm/s'], ['Acceleration', 'm/s²']],
};
const CHART_PERIOD = 0.033; // [s] between two drawings of the charts
const DASHES = [[10, 3], [2, 3], [10, 3, 2, 3], [5, 3]]; // of the terms, beside their colours
const SILENT = 1; // [s] without a state until `No data` is shown

const element = (id) => document.getElementById(id);
const history = new History();
const clock = new Clock();
const top = new TopView();
let facts = {
  mode: 'acc', axles: [-1.5, 1.5], mass: 2000, road: null, sliders: {}, tuning: {},
};
let road = new Road(null);
let [paused, plan] = [false, []];
let ended = false;
let drawn = {}; // the last drawing
let shown = null; // the state in it
let message_timer = null;
let received = null; // [ms] when the last state arrived, null where none is expected

const stale = () => { drawn = {}; };
const surface = (id) => new Surface(element(id), stale);
const [scene, course] = ['scene', 'course'].map(surface);
const speedChart = new Chart(surface('speed-chart'), [], 1, [-150, 150]);
const commandChart = new Chart(surface('command-chart'), [], 4, [-100, 100]);
const SPANS = { track: [0.1, 5], else: [1, 4] }; // of the charts' scales, at least
const PAPER_WIDTH = 720; // [px] of all canvases; the printer scales them, without stretching
const PAPER = [ // the canvases, each with its height [px]
  [scene, 260], [course, 60], [speedChart.surface, 200], [commandChart.surface, 200],
];
const speedPart = { chart: speedChart, legend: element('speed-legend') };
const commandPart = { chart: commandChart, legend: element('command-legend') };
const readColours = watchColours(stale);
const player = new Player(history);
const explorer = new Explorer(history, player, [speedPart, commandPart], stale);
const lesson = new Lesson();
const laps = new Laps();
const settings = new Settings();
const goal = new Goal(() => (facts.replay ? -Infinity : history.last('t')), stale);

/** Prepare the charts for a mode and a controller's terms. */
function prepareCharts({ mode, terms }) {
  const line = (column, width, more = {}) => ({ column, colour: QUANTITIES[column], width, ...more });
  const acc = mode === 'acc';
  const onTrack = mode === 'track';
  [speedChart.span, commandChart.span] = SPANS[mode] ?? SPANS.else;
  for (const [i, id] of ['speed-heading', 'command-heading'].entries()) {
    const [text, unit] = (HEADINGS[mode] ?? HEADINGS.else)[i];
    element(id).replaceChildren(`${text} `, make('small', {}, unit));
  }
  if (onTrack) {
    speedChart.lines = [line('e_y', 2.5)];
    commandChart.lines = [
      line('servo', 1.5, { name: 'steering', dash: [6, 4], scale: DEGREES }),
      line('e_psi', 2.5, { scale: DEGREES }),
    ];
  } else if (acc) {
    speedChart.lines = [
      line('measured_speed', 1, { name: 'measured', hidden: true }),
      line('reference', 1.5, { dash: [6, 4] }), line('speed', 2.5),
    ];
  } else {
    speedChart.lines = [line('absolute_speed', 2.5, { name: 'speed' })];
  }
  if (!onTrack) {
    commandChart.lines = [
      ...(acc ? terms.map((term, i) => line(term, 1.5, { colour: termColour(i), dash: DASHES[i % 4] })).reverse() : []),
      ...(acc ? [line('acting', 2.5, { name: 'motor', dash: [2, 4] })] : []),
      // The chart's limits follow this line, because the first proportional term is far larger.
      line('motor', 2.5, { name: 'command', leads: true }),
    ];
  }
  explorer.name(speedPart);
  explorer.name(commandPart);
}

function setState(state, text) {
  element('state').dataset.state = state;
  show(element('state-text'), text);
}

/** Show whether states arrive; if not, since when. */
function showState() {
  if (received === null || ended) return;
  const silent = Math.floor((performance.now() - received) / 1000);
  if (paused) setState('paused', 'Paused');
  else if (silent >= SILENT) setState('silent', `No data for ${silent} s`);
  else setState('live', 'Live');
}
setInterval(showState, 250);

function showTitle() {
  const title = facts.replay?.title ?? TITLES[facts.mode];
  element('title').textContent = explorer.other ? `${title} beside ${explorer.other.name}` : title;
  document.title = `${title} – barc_sim`;
}

/** Show a message, for some seconds or until the next one. */
function showMessage(text, seconds = 0) {
  clearTimeout(message_timer);
  element('message').textContent = text;
  element('message').hidden = !text;
  if (text && seconds) message_timer = setTimeout(() => showMessage(''), 1000 * seconds);
}

const connection = new Connection({
  hello(fields) {
    history.name(fields.columns, fields.continues);
    clock.restart();
    showMessage('');
    received = fields.replay ? null : performance.now();
    showState();
    this.facts(fields);
    document.body.toggleAttribute('data-replay', 'replay' in fields);
    if (fields.replay) player.begin(fields.replay);
    setConnected(!fields.replay);
    if (fields.laps) laps.update(fields.laps);
  },
  facts(fields) {
    const way = JSON.stringify(fields.track ?? fields.road);
    facts = fields;
    if (way !== this.way) {
      this.way = way;
      road = fields.track ? new Track(fields.track) : new Road(fields.road);
      history.use(fields.track ? road : null);
    }
    document.body.dataset.mode = fields.mode;
    showTitle();
    tuning.receive(fields);
    settings.add(history.count ? history.last('t') : -Infinity, fields.tuning);
    history.mass = fields.mass;
    element('finish').hidden = !fields.can_finish;
    const prepared = JSON.stringify([fields.mode, fields.terms]);
    if (prepared !== this.prepared) {
      this.prepared = prepared;
      prepareCharts(fields);
      explorer.use(fields.mode === 'teleop' ? 't' : element('axis').value);
      lesson.prepare(fields);
      this.noisy = false;
    }
    const noisy = fields.tuning.noise_v_x > 0;
    if (noisy !== this.noisy) explorer.reveal('measured_speed', noisy); // without noise it is the speed
    this.noisy = noisy;
    stale();
  },
  /** Prepare for the rows of a second run, which come next. */
  other({ title, columns, laps: lapsOfOther }) {
    const second = new History();
    second.mass = facts.mass;
    second.track = history.track;
    second.name(columns, false);
    const other = new Laps();
    other.update(lapsOfOther);
    explorer.other = { history: second, laps: other, name: title, loading: true };
    showTitle();
    lesson.compareWith(title, other);
  },
  rows(rows) {
    if (explorer.other?.loading) {
      explorer.other.loading = false;
      explorer.other.history.add(rows);
      return;
    }
    history.add(rows);
    if (rows.length && received !== null) received = performance.now();
    if (facts.replay) player.loaded();
  },
  status(status) {
    ({ paused, plan } = status);
    laps.update(status.laps);
    if (shown) showLaps(shown);
    element('factor').textContent = reading(status.factor, 2);
    element('missed').textContent = status.missed ?? '–';
    element('missed-fact').classList.toggle('bad', status.missed > 0);
    element('pause').setAttribute('aria-pressed', paused);
    element('pause').textContent = paused ? 'Resume' : 'Pause';
    showState();
  },
  tuned({ name, value }) {
    tuning.parameters.accept(name, value);
  },
  refused({ what, why }) {
    if (what in facts.sliders) tuning.parameters.refuse(what, why);
    else showMessage(`Cannot ${what}: ${why}.`, 6);
  },
  end(fields) {
    const { reason } = fields;
    ended = true;
    setState('ended', 'Ended');
    showMessage(reason, 8);
    document.body.toggleAttribute('data-ended', true);
    if (fields.laps) laps.update(fields.laps);
    stale();
    lesson.end(fields, facts.mode === 'teleop' ? 'barc teleop' : tuning.command(facts.controller_type, facts.run));
    setConnected(false);
  },
  lost() {
    received = null;
    setConnected(false);
    setState('lost', 'Reconnecting');
    showMessage('The connection to the run was lost. This page reconnects by itself; a new run has a new address.');
  },
  closed(reason) {
    received = null;
    setConnected(false);
    setState('refused', 'Disconnected');
    showMessage(`The run closed this connection (${reason}). Reload the page to try again.`);
  },
});
const tuning = new Tuning((name, value) => connection.send('tune', { name, value }));
let connected = false;

/** Enable the controls that act on the run, or disable them: what they do would be lost. */
function setConnected(now) {
  connected = now;
  for (const button of document.querySelectorAll('.actions button, #reset-controller')) {
    button.disabled = !now;
  }
  document.body.toggleAttribute('data-connected', now);
  tuning.parameters.connect(now);
  if (!now) driving.release();
}
const reset = () => connection.send('reset');
const pause = () => connection.send('pause', { on: !paused });
element('reset-controller').addEventListener('click', () => connection.send('reset_controller'));
element('copy-command').addEventListener('click', async () => {
  const command = tuning.command(facts.controller_type, facts.run);
  element('tuning-note').textContent = (await copy(command)) ? `Copied: ${command}` : command;
});
const dark = matchMedia('(prefers-color-scheme: dark)');
/** Use 'dark', 'light' or, if empty, the system's colours; the button offers the other ones. */
function setTheme(theme) {
  document.documentElement.dataset.theme = theme;
  const isDark = theme ? theme === 'dark' : dark.matches;
  show(element('theme'), isDark ? 'Light' : 'Dark');
  readColours();
}
element('theme').addEventListener('click', () => setTheme(element('theme').textContent.toLowerCase()));
dark.addEventListener('change', () => setTheme(document.documentElement.dataset.theme ?? ''));
// On paper: light, and drawn before the page is printed.
let themeOnScreen = '';
addEventListener('beforeprint', () => {
  themeOnScreen = document.documentElement.dataset.theme ?? '';
  for (const [surface, height] of PAPER) surface.putOnPaper(PAPER_WIDTH, height);
  setTheme('light');
  drawNow(performance.now());
});
addEventListener('afterprint', () => {
  for (const [surface] of PAPER) surface.putOnScreen();
  setTheme(themeOnScreen);
});
element('reset').addEventListener('click', reset);
element('pause').addEventListener('click', pause);
element('finish').addEventListener('click', () => connection.send('finish'));
const driving = new Driving(
  (forward, turn, brake) => connection.send('drive', { forward, turn, brake }),
  () => facts.mode === 'teleop' && connected,
  { KeyR: reset, KeyP: pause },
);

const degrees = (radians) => radians * DEGREES;

/** Show the laps that belong to a state: its own, the one before, and the best. */
function showLaps(state) {
  if (!laps.latest) return;
  if (laps.latest.table) showTrackLaps(laps.latest, state.lap);
  else lesson.showLaps(laps.beside(state.lap), state.lap);
}

/** Return a heading in whole degrees, from −179 to 180. */
function headingOf(psi) {
  const behind = (180 - Math.round(degrees(psi))) % 360;
  return 180 - (behind < 0 ? behind + 360 : behind);
}

function showReadings(state) {
  const teleop = facts.mode === 'teleop';
  if (teleop) show(element('speed-label'), state.speed < -0.005 ? 'Speed |v|, in reverse' : 'Speed |v|');
  const texts = {
    time: reading(state.t, 1),
    speed: reading(teleop ? state.absolute_speed : state.speed, 2),
    reference: reading(state.reference, 2),
    'lap-number': reading(state.track_lap + 1, 0),
    'lap-time': reading(state.lap_time, 1),
    'e-y': reading(state.e_y, 3),
    'e-psi': reading(degrees(state.e_psi), 1),
    error: reading(state.reference - state.speed, 3),
    position: reading(state.x, 1),
    grade: reading(state.theta_deg, 0),
    heading: reading(headingOf(state.psi), 0),
    steering: reading(degrees(state.servo), 1),
    place: `${reading(state.x, 1)}, ${reading(state.y, 1)}`,
    command: reading(state.motor, 2),
  };
  for (const [id, text] of Object.entries(texts)) {
    show(element(id), text);
  }
}

function draw(milliseconds) {
  requestAnimationFrame(draw);
  drawNow(milliseconds);
}

function drawNow(milliseconds) {
  const now = milliseconds / 1000;
  const newest = history.last('t');
  const time = player.advance(now, facts.replay ? NaN : clock.advance(now, newest));
  const state = history.state(time);
  shown = state;
  if (state) road.learn(state);
  if (drawn.time === time && drawn.count === history.count && drawn.settled) return;
  const charts = !(now < drawn.next);
  const tuningThen = state && settings.at(state.t);
  if (state) explorer.laps = laps.beside(state.lap);
  if (facts.mode === 'teleop') {
    if (state) goal.update(history, state.t, (facts.axles[0] + facts.axles[1]) / 2);
    top.draw(scene, history, facts.axles, state, goal, state && goal.ghost(history, state.t));
  } else if (facts.mode === 'track') {
    const [ghost] = state ? explorer.ghosts(state) : [];
    const then = ghost && state.t - ghost.shift <= ghost.end ? ghost.history.state(state.t - ghost.shift) : null;
    top.draw(scene, history, facts.axles, state, goal, then, road, state && aimOf(tuningThen, state.speed), player.held ? [] : plan);
  } else {
    const ghosts = state ? explorer.ghosts(state).map(({ name, history: rows, shift, end }) => (
      { ...rows.state(Math.min(state.t - shift, end)), name: name === 'other' ? 'other run' : [`${name} lap`, laps.beside(state.lap)[name].gains].filter(Boolean).join(': ') }
    )) : [];
    drawSide(scene, road, facts, state, ghosts);
  }
  let { next } = drawn;
  if (charts) {
    const began = performance.now();
    if (facts.mode === 'acc') drawCourse(course, road, state);
    commandChart.limit = (facts.mode === 'acc' && tuningThen?.motor_limit) || 0;
    explorer.draw(state, road);
    if (state) showReadings(state);
    if (state) showLaps(state);
    if (state && facts.mode !== 'teleop') lesson.update(state, { ...facts, tuning: tuningThen });
    // Long charts take long to draw: most frames draw only the picture.
    next = now + Math.max(CHART_PERIOD, (4 * (performance.now() - began)) / 1000);
  }
  // The camera keeps moving for a while after the last state.
  const still = drawn.time === time ? (drawn.still ?? 0) + 1 : 0;
  drawn = {
    time, count: history.count, still, settled: still > 60 && charts, next,
  };
}
setTheme('');
setConnected(false);
requestAnimationFrame(draw);
