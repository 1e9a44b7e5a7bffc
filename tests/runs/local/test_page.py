"""The live page of a run without ROS drives, tunes, pauses and resets."""

from __future__ import annotations

import json
import os
import signal
import socket
import time
from contextlib import ExitStack, suppress
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

import numpy as np
import pytest
from browser import CHROMIUM, Browser, wait_until
from elsewhere import ELSEWHERE
from page_client import connect_page, rows
from rosbags.highlevel import AnyReader

from barc_sim import read_bag
from barc_sim.control.pid import PID
from barc_sim.simulation.metrics import laps_of
from barc_sim.vehicle.bike_model import Vehicle

if TYPE_CHECKING:
    import subprocess
    from collections.abc import Callable
    from pathlib import Path

    from websockets.sync.client import ClientConnection

    from barc_sim.simulation.log import Log

PATIENCE = 30.0  #: [s]
FORCES = ('motor', 'gravity', 'drag', 'friction')
#: Keeps what is drawn: the ghosts' lines in their values, pale cars, posts and arrows in pixels.
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
    window.scene = { cars: [], posts: [], arrows: [], at: performance.now() };
  });
  watch('translate', (x) => context.globalAlpha < 1 && scene.cars.push(x));
  watch('fillText', (text, x) => {
    if (/^\\d+ m$/.test(text)) scene.posts.push([parseFloat(text), x]);
  });
  watch('lineTo', (x) => context.lineWidth === 4 && scene.arrows.push(x));
})"""


@pytest.fixture
def begin(
    start: Callable[..., subprocess.Popen[str]],
) -> Callable[..., tuple[subprocess.Popen[str], str]]:
    """Return a function that starts a run without ROS, and returns it with its page's address."""

    def begin(*words: str) -> tuple[subprocess.Popen[str], str]:
        local = ('--engine', 'local', '--view', 'web')
        process = start('-m', 'barc_sim', *words, *local, env=os.environ | ELSEWHERE)
        assert process.stdout
        assert process.stdout.readline() == 'engine     local, without ROS\n'
        return process, process.stdout.readline().split()[-1]

    return begin


def wait(connection: ClientConnection, what: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    """Return the first message, or row of a state, for which `what` is true."""
    until = time.monotonic() + PATIENCE
    while time.monotonic() < until:
        message = connection.recv(timeout=PATIENCE)
        found = [json.loads(message)] if isinstance(message, str) else [*rows(message)]
        for each in found:
            if what(each):
                return each
    raise AssertionError('it did not come')


def test_page_drives_by_hand(begin: Callable[..., Any], tmp_path: Path) -> None:
    process, url = begin('teleop')
    with connect_page(url) as socket:
        wait(socket, lambda m: m.get('type') == 'hello')
        until = time.monotonic() + 1.0
        while time.monotonic() < until:
            socket.send(json.dumps({'type': 'drive', 'linear': 1.0, 'angular': 0.0}))
            time.sleep(0.1)
        wait(socket, lambda m: m.get('speed', 0.0) > 1.0)
        socket.send(json.dumps({'type': 'reset'}))
        wait(socket, lambda m: m.get('x') == 0.0 and m.get('t', 0.0) > 0.5)
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=PATIENCE)
    assert process.returncode == 0
    log = read_bag(next((tmp_path / 'bags').iterdir()))
    assert log.speed.max() > 1.0


def test_page_tunes_and_pauses(begin: Callable[..., Any], tmp_path: Path) -> None:
    process, url = begin('acc', '--laps', '0')
    with connect_page(url) as socket:
        wait(socket, lambda m: m.get('tuning', {}).get('kp') == 30.0)
        socket.send(json.dumps({'type': 'tune', 'name': 'kp', 'value': 20.0}))
        wait(socket, lambda m: m.get('tuning', {}).get('kp') == 20.0)
        socket.send(json.dumps({'type': 'tune', 'name': 'kp', 'value': -2e6}))
        refused = wait(socket, lambda m: m.get('type') == 'refused')
        assert 'Parameter kp out of range' in refused['why']
        socket.send(json.dumps({'type': 'tune', 'name': 'motor_delay', 'value': 0.3}))
        wait(socket, lambda m: m.get('tuning', {}).get('motor_delay') == 0.3)
        socket.send(json.dumps({'type': 'pause', 'on': True}))
        wait(socket, lambda m: bool(m.get('paused')))
        process.send_signal(signal.SIGINT)
        end = wait(socket, lambda m: m.get('type') == 'end')
        assert end['reason'] == 'The run has ended.'
    process.communicate(timeout=PATIENCE)
    assert process.returncode == 0
    with AnyReader([next((tmp_path / 'bags').iterdir())]) as reader:
        events = [
            reader.deserialize(data, connection.msgtype)
            for connection, _, data in reader.messages()
            if connection.topic == '/parameter_events'
        ]
    changed = [
        (event.node, parameter.name, parameter.value.double_value)  # type: ignore[attr-defined]
        for event in events
        for parameter in event.changed_parameters  # type: ignore[attr-defined]
    ]
    assert changed == [('/controller', 'kp', 20.0), ('/vehicle_simulator', 'motor_delay', 0.3)]


@pytest.mark.slow
def test_more_half_open_connections_than_descriptors_end_no_run(
    begin: Callable[..., Any], tmp_path: Path
) -> None:
    resource = pytest.importorskip('resource')
    _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))
    process, url = begin('acc', '--laps', '0')
    resource.prlimit(process.pid, resource.RLIMIT_NOFILE, (1024, 1024))
    where = urlsplit(url)
    with ExitStack() as stack:
        for _ in range(1100):
            half = stack.enter_context(socket.create_connection((where.hostname, where.port)))
            with suppress(OSError):  # closed already
                half.send(b'GET / HTTP/1.1\r\n')
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=PATIENCE)
    assert process.returncode == 0
    assert 'Traceback' not in errors
    (bag,) = (tmp_path / 'bags').iterdir()
    assert (bag / 'metadata.yaml').exists()


@pytest.mark.slow
@pytest.mark.skipif(not CHROMIUM, reason='there is no Chromium')
def test_ghosts_forces_and_terms_drawn_are_those_of_the_bag(
    begin: Callable[..., Any], tmp_path: Path
) -> None:
    process, url = begin('acc', '--laps', '0', '--distance', '30', '--realtime-factor', '6')
    last = "document.querySelector('[data-figure=rms] td:nth-of-type(2)').innerText"
    with Browser() as browser:
        tab = browser.open(url, width=1440, height=900)
        tab.media(prefers_reduced_motion='reduce')  # the charts' limits are the values' at once
        tab.select('#axis', 'x')
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
        tab.select('#seek', 3.5, 'input')
        tab.until("document.querySelector('#grade').innerText === '10'")
        forces = [tab.number(f'#force-{name}') for name in FORCES]
        shafts = np.reshape(tab.run('scene.arrows'), (-1, 5))  # a line, and a head of three points
        terms = [tab.number(f'#term-{name}') for name in ('motor', *PID.terms)]
        tab.close()
    process.communicate(timeout=PATIENCE)
    log = read_bag(next((tmp_path / 'bags').iterdir()))
    laps, number = laps_of(log)
    ghosts = [lap for lap in (laps.last, laps.best) if lap]
    assert ghosts[0] != ghosts[1]
    columns = {'speed-chart': ['speed'], 'command-chart': [*reversed(PID.terms), 'motor']}
    for chart, names in columns.items():
        drawn = [(lap, name) for lap in ghosts for name in names]
        for (lap, name), line in zip(drawn, lines[chart], strict=True):
            rows = np.flatnonzero(np.array(number) == lap.number)
            assert len(rows) - 1 <= len(line)  # no term is known before the first command
            _assert_drawn(line, log, rows[-len(line) :], getattr(log, name, None))
    posts = np.array(scene['posts'])
    for lap, place in zip(ghosts, scene['cars'][::3], strict=True):  # body, wheel, wheel
        t = min(now - laps.current.start + lap.start, lap.end)
        expected = np.interp(np.interp(t, log.t, log.distance), *posts.T)
        assert place == pytest.approx(expected, abs=1.0)  # [px]
    k = int(np.searchsorted(log.t, 3.5 - 1e-9))
    commands = {
        tuple(round(float(log.columns()[name][row]), 3) for name in ('motor', *PID.terms)): row
        for row in (k - 1, k)
    }
    motor = Vehicle().mass * log.motor[commands[tuple(terms)]]
    assert forces[0] == round(motor)
    assert forces[1] == round(log.gravity[k])
    assert forces[2:] == [round(log.drag[k], 2), round(log.friction[k], 2)]
    arrows = shafts[:, 2] - shafts[:, 0]
    assert arrows[1] / arrows[0] == pytest.approx(log.gravity[k] / motor, abs=1e-3)


def _assert_drawn(line: list[list[float]], log: Log, rows: Any, values: Any) -> None:  # noqa: ANN401
    """Compare a line with the bag; a state's command may come after its row, as the next one's."""
    x, drawn = np.array(line).T
    np.testing.assert_allclose(x, log.distance[rows], atol=1e-6)
    now, before = (np.isclose(drawn, values[k], atol=1e-6) for k in (rows, np.maximum(rows - 1, 0)))
    assert (now | before).all()
