"""The last and the best lap, drawn behind the car on the live page."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from browser import CHROMIUM, wait_until

from barc_sim import read_bag
from barc_sim.control.pid import PID
from barc_sim.simulation.metrics import laps_of

if TYPE_CHECKING:
    import subprocess
    from collections.abc import Callable
    from pathlib import Path

    from browser import Browser

    from barc_sim.simulation.log import Log

PATIENCE = 30.0  #: [s]
#: Keeps what is drawn: the ghosts' lines in their values, pale cars and posts in pixels.
WATCH = """import('./chart.js').then(({ Chart }) => {
  window.lines = {};
  const { draw } = Chart.prototype;
  Chart.prototype.draw = function (history, state, view) {
    const { context, canvas } = this.surface;
    const paths = [];
    let bottom;
    const own = Object.getPrototypeOf(context);
    context.beginPath = () => { paths.push([]); own.beginPath.call(context); };
    context.rect = (x, y, w, h) => { bottom = [y + 2, h - 4]; own.rect.call(context, x, y, w, h); };
    for (const name of ['moveTo', 'lineTo']) {
      context[name] = (x, y) => {
        if (context.globalAlpha < 1) paths.at(-1).push([x, y]);
        own[name].call(context, x, y);
      };
    }
    draw.call(this, history, state, view);
    for (const name of ['beginPath', 'rect', 'moveTo', 'lineTo']) delete context[name];
    const [low, high] = this.shown;
    lines[canvas.id] = paths.filter((path) => path.length).map((path) => path.map(
      ([x, y]) => [this.value(x, view.range), high - (y - bottom[0]) / bottom[1] * (high - low)],
    ));
  };
  const context = document.querySelector('#scene').getContext('2d');
  const watch = (name, note) => {
    const own = context[name];
    context[name] = (...given) => { note(...given); return own.apply(context, given); };
  };
  watch('clearRect', () => {
    window.scene = { cars: [], posts: [], at: performance.now() };
  });
  watch('translate', (x) => context.globalAlpha < 1 && scene.cars.push(x));
  watch('fillText', (text, x) => {
    if (/^\\d+ m$/.test(text)) scene.posts.push([parseFloat(text), x]);
  });
})"""


@pytest.mark.slow
@pytest.mark.skipif(not CHROMIUM, reason='there is no Chromium')
def test_ghosts_drawn_are_those_of_the_bag(
    browser: Browser, start: Callable[..., subprocess.Popen[str]], tmp_path: Path
) -> None:
    lap = ('--laps', '0', '--distance', '30', '--realtime-factor', '6')
    process = start('-m', 'barc_sim', 'acc', *lap, '--engine', 'local', '--view', 'web')
    assert process.stdout
    _, url = (process.stdout.readline().split()[-1] for _ in range(2))
    last = "document.querySelector('[data-figure=rms] td:nth-of-type(2)').innerText"
    tab = browser.open(url, width=1440, height=900)
    tab.media(prefers_reduced_motion='reduce')  # the charts' limits are the values' at once
    tab.select('#axis', 'place')
    tab.run(WATCH)
    tab.until(f'Number({last}) > 0')
    first = tab.run(last)
    for gain in ('kp', 'ki'):
        tab.select(f'#{gain}', 2)
    tab.until(f'{last} !== {first!r}')
    wait_until(lambda: 6.0 < tab.number('#position') < 20.0)
    tab.click('#finish')
    wait_until(lambda: tab.text('#state') == 'Ended')
    tab.until('performance.now() - scene.at > 200')  # the last state is drawn
    now = tab.run("Number(document.querySelector('#seek').max)")
    lines, scene = tab.run('[lines, scene]')
    tab.close()
    process.communicate(timeout=PATIENCE)
    log = read_bag(next((tmp_path / 'bags').iterdir()))
    laps, number = laps_of(log)
    ghosts = [lap for lap in (laps.last, laps.best) if lap]
    assert ghosts[0] != ghosts[1]
    commands = [*reversed(PID.terms), 'acting', 'motor']
    columns = {'speed-chart': ['speed'], 'command-chart': commands}
    for chart, names in columns.items():
        drawn = [(lap, name) for lap in ghosts for name in names]
        for (lap, name), line in zip(drawn, lines[chart], strict=True):
            rows = np.flatnonzero(np.array(number) == lap.number)
            assert len(rows) - 1 <= len(line)  # no term is known before the first command
            # What acts is the command, as this motor has no limit, lag or delay.
            values = log.motor if name == 'acting' else getattr(log, name)
            _assert_drawn(line, log, rows[-len(line) :], values)
    posts = np.array(scene['posts'])
    for lap, place in zip(ghosts, scene['cars'][::3], strict=True):  # body, wheel, wheel
        t = min(now - laps.current.start + lap.start, lap.end)
        expected = np.interp(np.interp(t, log.t, log.distance), *posts.T)
        assert place == pytest.approx(expected, abs=1.0)  # [px]


def _assert_drawn(line: list[list[float]], log: Log, rows: Any, values: Any) -> None:  # noqa: ANN401
    """Compare a line with the bag; a state's command may come after its row, as the next one's."""
    x, drawn = np.array(line).T
    np.testing.assert_allclose(x, log.distance[rows], atol=1e-6)
    now, before = (np.isclose(drawn, values[k], atol=1e-6) for k in (rows, np.maximum(rows - 1, 0)))
    assert (now | before).all()
