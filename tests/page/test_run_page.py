"""The page of a run: whose keys drive; and a recorded run in it."""

from __future__ import annotations

import base64
import json
import os
import re
import signal
import subprocess
import sys
import zlib
from contextlib import closing, contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from browser import CHROMIUM, SIZES, wait_until
from hypothesis import given
from hypothesis import strategies as st

from barc_sim.__main__ import main as barc
from barc_sim.bags import reader as bag
from barc_sim.control.driver import COAST, FULL_BRAKE, STALE_AFTER, DriverInput
from barc_sim.control.lane import Stanley
from barc_sim.control.speed import PID
from barc_sim.page import run_page
from barc_sim.page.opening import RedirectFile
from barc_sim.page.protocol import COLUMNS
from barc_sim.page.run_page import DriverArbiter, GhostRun, replay
from barc_sim.page.server import ViewServer
from barc_sim.simulation import metrics
from barc_sim.simulation.closed_loop import closed_loop, lap
from barc_sim.simulation.log import Log
from barc_sim.simulation.metrics import track_laps_of
from barc_sim.vehicle.bike_model import Vehicle
from barc_sim.vehicle.plant import Actuator, Plant

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from contextlib import AbstractContextManager

    from browser import Browser, Tab

    Played = Callable[..., AbstractContextManager[Tab]]

#: Scripts that a test runs on the page.
PROGRAMS = Path(__file__).with_name('programs')
_SERVE = (
    'from barc_sim.page.run_page import serve;'
    'from barc_sim.simulation.closed_loop import closed_loop;'
    "serve(closed_loop(distance=3.0), 'run', '127.0.0.1', 0)"
)


@pytest.fixture
def log() -> Log:
    return closed_loop()


def in_browser(test: Callable[..., None]) -> Callable[..., None]:
    """Mark a test that needs a browser."""
    reason = "Debian's chromium is not installed"
    return pytest.mark.timeout(300)(pytest.mark.skipif(CHROMIUM is None, reason=reason)(test))


@pytest.fixture
def played(browser: Browser) -> Played:
    """Return a function that opens a run in the browser, beside another; the page plays."""

    @contextmanager
    def play(log: Log, other: Log | None = None, **size: Any) -> Iterator[Tab]:  # noqa: ANN401
        ghost = GhostRun(other, 'reference') if other else None
        server = ViewServer(greeting=replay(log, 'my run', ghost))
        server.start()
        with closing(server):
            tab = browser.open(server.url, **size)
            wait_until(lambda: tab.number('#time') > 0.2)
            yield tab
            assert tab.problems == []
            tab.close()

    return play


def test_the_page_receives_the_whole_run(log: Log) -> None:
    hello, rows = replay(replace(log, missed=log.t > log.t[-4]), 'my run')
    hello_fields = json.loads(hello)

    assert (hello_fields['mode'], hello_fields['replay']) == (
        'acc',
        {'title': 'my run', 'missed': 3},
    )
    assert hello_fields['road']['grades_deg'][:2] == [0.0, 10.0]
    assert isinstance(rows, bytes)
    assert len(rows) == 8 * len(COLUMNS) * len(log)


def test_a_run_without_a_controller_is_shown_from_above(log: Log) -> None:
    hello, _ = replay(replace(log, reference=np.full(len(log), np.nan)), '')
    assert json.loads(hello)['mode'] == 'teleop'


def test_a_replay_is_served_until_ctrl_c() -> None:
    with subprocess.Popen(
        [sys.executable, '-c', _SERVE],
        stdout=subprocess.PIPE,
        text=True,
        cwd=Path(__file__).parents[2],
        env={**os.environ, 'DISPLAY': '', 'WAYLAND_DISPLAY': ''},
    ) as process:
        assert process.stdout
        assert process.stdout.readline().startswith('http://127.0.0.1:')

        process.send_signal(signal.SIGINT)
        assert process.wait(30) == 0


def test_the_command_replay_serves_one_run_or_two(
    log: Log, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    served: list[object] = []
    monkeypatch.setattr(bag, 'read', lambda *_: log)
    monkeypatch.setattr(run_page, 'serve', lambda *arguments: served.extend(arguments))
    assert barc(['replay', str(tmp_path), '--view-port', '8080']) == 0
    assert served == [log, tmp_path.name, '127.0.0.1', 8080, None]

    served.clear()
    other = tmp_path / 'other'
    assert barc(['replay', str(tmp_path), str(other)]) == 0
    assert served[-1] == (log, 'other')
    assert barc(['replay', str(tmp_path), str(other), '--save', 'a.gif']) == 2


@in_browser
def test_browser_follows_the_private_file_to_the_page(log: Log, browser: Browser) -> None:
    server = ViewServer(greeting=replay(log, 'my run'))
    server.start()
    with closing(server):
        file = RedirectFile(server.url)

        tab = browser.open('about:blank')
        tab.ask('Page.navigate', url=file.address)
        tab.until(f'location.href === {server.url!r}')
        wait_until(lambda: tab.number('#time') > 0.2)
        assert tab.problems == []

        tab.close()
        file.remove()


@in_browser
def test_the_page_plays_pauses_and_seeks(log: Log, played: Played) -> None:
    with played(log) as tab:
        assert tab.text('#title') == 'my run'

        tab.click('#play')
        wait_until(lambda: tab.text('#play') == 'Play')
        _seek(tab, 13.0)
        wait_until(lambda: tab.number('#time') == 13.0)
        assert tab.number('#position') == pytest.approx(
            np.interp(13.0, log.t, log.distance), abs=0.1
        )
        assert tab.text('#seek-time') == f'13.0 / {log.t[-1]:.1f} s'

        tab.click('#play')
        wait_until(lambda: tab.number('#time') > 13.2)
        tab.type('Space')
        wait_until(lambda: tab.text('#play') == 'Play')
        before = tab.number('#time')
        tab.type('ArrowLeft')
        wait_until(lambda: tab.number('#time') == pytest.approx(before - 1.0, abs=0.11))
        tab.focus_by_tab('#pace')
        tab.type('ArrowDown')
        assert tab.run("document.querySelector('#pace').value") == '2'

        tab.focus_by_tab('#seek')
        tab.type('ArrowRight')
        wait_until(lambda: tab.number('#time') == pytest.approx(before, abs=0.11))


@in_browser
def test_a_chart_can_be_zoomed_read_hidden_and_saved(log: Log, played: Played) -> None:
    with played(log, width=1440, height=900) as tab:
        tab.click('#play')
        _seek(tab, 20.0)
        wait_until(lambda: tab.number('#time') == 20.0)
        # The middle of the chart is half its window before the shown time.
        tab.select('#axis', 't')
        tab.hover('#speed-chart')
        at = float(np.interp(10.0, log.t, log.speed))
        wait_until(lambda: tab.number('#speed-legend .value') == pytest.approx(at, abs=0.05))
        tab.select('#axis', 'place')
        tab.hover('#command-chart')
        middle = float(np.interp(90.0, log.distance, log.motor))
        wait_until(lambda: tab.number('#command-legend .value') == pytest.approx(middle, abs=0.05))
        tab.remember('#speed-chart')
        tab.wheel('#speed-chart', -120)
        wait_until(lambda: tab.changed('#speed-chart') > 500)
        tab.focus_by_tab('#speed-legend button')
        tab.type('Space')
        tab.until("document.querySelector('#speed-legend button').ariaPressed === 'false'")
        tab.run(
            'URL.createObjectURL = (blob) => { (window.saved ??= []).push(blob);'
            "return '#'; }; HTMLAnchorElement.prototype.click = function () {}"
        )
        tab.click('#save-csv')
        table = tab.run('saved[0].text()').splitlines()
        assert table[0].split(',') == [*COLUMNS, 'acting', 'place']
        assert len(table) == len(log) + 1

        speeds = [float(line.split(',')[COLUMNS.index('speed')]) for line in table[1:]]
        np.testing.assert_array_equal(speeds, log.speed)


@in_browser
def test_the_grades_are_written_below_the_lines_of_a_chart(log: Log, played: Played) -> None:
    with played(log, width=1440, height=900) as tab:
        tab.run_file(PROGRAMS / 'note_grades.js')
        wait_until(lambda: tab.run('names.length') > 3)
        assert min(tab.run('names')) >= 0.0


@in_browser
def test_the_arrow_shows_the_force_of_the_plant(played: Played) -> None:
    plant = Plant(motor=Actuator(limit=6.0, delay=0.1))
    log = closed_loop(plant, PID(4.0, 8.0, 0.0, output_min=-100.0, output_max=100.0))

    with played(log) as tab:
        tab.click('#play')
        for row in (20, 60, 300, *range(700, 1000, 50)):
            _seek(tab, log.t[row])
            tab.until(f"document.querySelector('#time').textContent === '{log.t[row]:.1f}'")

            acted = min(max(log.motor[row - 5], -6.0), 6.0)  # 0.1 s before, within the limit
            force = pytest.approx(Vehicle().mass * acted, rel=0.01, abs=1.0)
            wait_until(lambda force=force: tab.number('#force-motor') == force)


@in_browser
def test_a_second_run_is_drawn_beside_the_first(log: Log, played: Played) -> None:
    weak = closed_loop(controller=PID(4.0, 0.0, 0.0, output_min=-8.0, output_max=8.0))
    with played(weak, log, width=1440, height=900) as tab:
        cells = "Array.from(document.querySelectorAll('[data-figure=rms] td'), (c) => c.innerText)"
        texts = [f'{metrics.summary(run).rms_error_after_run_up:.3f}' for run in (weak, log)]
        assert tab.run(cells)[:2] == texts
        assert tab.text('.laps.acc thead').strip().split('\t')[1:] == ['this run', 'other run']

        tab.click('#play')
        _seek(tab, 12.0)
        wait_until(lambda: tab.number('#time') == 12.0)
        tab.remember('#speed-chart')
        tab.run("import('./explorer.js').then((m) => { m.Explorer.prototype.ghosts = () => []; })")
        _seek(tab, 12.02)
        wait_until(lambda: tab.changed('#speed-chart') > 100)


_STREAM = re.compile(rb'<<((?:(?!endobj).)*?)>>\s*stream\r?\n(.*?)endstream', re.DOTALL)
_SCALE = re.compile(rb'(-?[\d.]+) 0 0 (-?[\d.]+) -?[\d.]+ -?[\d.]+ cm')


def scales(pdf: bytes) -> list[float]:
    """Return by how much each thing in a PDF is scaled to the right, per scale downwards."""
    ratios = []
    for header, data in _STREAM.findall(pdf):
        if b'/FlateDecode' in header and b'/FontFile' not in header:
            with suppress(zlib.error):
                for along, down in _SCALE.findall(zlib.decompress(data)):
                    ratios.append(abs(float(along) / float(down)))
    return ratios


@in_browser
def test_a_print_keeps_the_shapes_and_the_chosen_colours(log: Log, played: Played) -> None:
    with played(log, width=1440, height=900) as tab:
        tab.dark(on=False)
        tab.click('#theme')
        wait_until(lambda: tab.text('#theme') == 'Light')
        pdf = base64.b64decode(tab.ask('Page.printToPDF')['data'])
        ratios = scales(pdf)
        assert len(ratios) >= 4  # the canvases, at least
        assert ratios == pytest.approx([1.0] * len(ratios), rel=0.01)
        assert tab.text('#theme') == 'Light'

        box = "document.querySelector('#speed-chart').getBoundingClientRect()"
        canvas = "document.querySelector('#speed-chart')"
        tab.until(f'Math.abs({canvas}.width / {canvas}.height - {box}.width / {box}.height) < 0.02')


@in_browser
def test_the_laps_of_a_replay_are_those_of_the_shown_time(played: Played) -> None:
    parts = [closed_loop(controller=PID(kp, 8.0, 0.0), distance=40.0) for kp in (4.0, 6.0, 8.0)]
    log = joined(*parts)
    laps = [*metrics.laps_of(log)[0]]
    assert len(laps) == 3
    other = joined(*parts[1:])
    cells = "Array.from(document.querySelectorAll('[data-figure=rms] td'), (c) => c.innerText)"

    def rms(lap: metrics.Lap) -> str:
        return f'{lap.summary.rms_error_after_run_up:.3f}'

    with played(log) as tab:
        tab.click('#play')
        for k in (2, 0, 1):
            _seek(tab, 0.5 * (laps[k].start + laps[k].end))
            expected = [rms(laps[k]), rms(laps[k - 1]) if k else '\N{EN DASH}']
            wait_until(lambda expected=expected: tab.run(cells)[:2] == expected)
    with played(log, other) as tab:
        tab.click('#play')
        for k, beside in ((0, 0), (1, 1), (2, 1)):  # the same lap of the other run, or its last
            _seek(tab, 0.5 * (laps[k].start + laps[k].end))
            expected = [rms(laps[k]), rms([*metrics.laps_of(other)[0]][beside])]
            wait_until(lambda expected=expected: tab.run(cells)[:2] == expected)


def joined(*logs: Log) -> Log:
    """Return a run that begins anew between the logs."""
    columns: dict[str, list[np.ndarray]] = {}
    start = 0.0
    for log in logs:
        shifted = replace(log, t=log.t + start)
        start = shifted.t[-1] + 0.02
        for name, values in shifted.columns().items():
            columns.setdefault(name, []).append(values)
    return Log(**{name: np.concatenate(values) for name, values in columns.items()})


@in_browser
def test_a_finger_moves_the_chart(log: Log, played: Played) -> None:
    with played(log, width=740, height=360, touch=True) as tab:
        tab.click('#play')
        _seek(tab, 20.0)
        tab.select('#axis', 't')
        wait_until(lambda: tab.number('#time') == 20.0)

        x, y = tab.middle('#speed-chart')
        tab.touch('touchStart', (x, y))
        for by in range(5, 105, 5):
            tab.touch('touchMove', (x + by, y))
        tab.touch('touchEnd')

        wait_until(lambda: 10.0 < tab.number('#time') < 19.0)


@in_browser
def test_nothing_is_cut_at_any_size_and_every_control_works_by_keyboard(
    log: Log, played: Played
) -> None:
    with played(log, log) as tab:
        _seek(tab, 14.0)
        for width, height, touch in SIZES:
            tab.resize(width, height, touch=touch)
            assert [*tab.overflow(), *tab.cut_labels()] == [], (width, height)
        assert tab.without_keyboard() == []


@in_browser
def test_a_track_has_its_errors_and_the_best_lap_as_a_ghost(played: Played) -> None:
    log = lap(Stanley(), 'oval', speed=8.0, laps=3, noise=0.2, seed=1)
    laps, numbers = track_laps_of(log)
    assert laps.best
    row = numbers.index(next(each.number for each in laps.finished if each != laps.best)) + 500
    with played(log, width=1440, height=900) as tab:
        assert tab.run('document.body.dataset.mode') == 'track'

        best = tab.text('#track-laps .best').split()
        assert best[:2] == [f'{laps.best.number + 1}', f'{laps.best.time:.2f}']

        tab.click('#play')
        tab.run_file(PROGRAMS / 'note_cars.js')
        _seek(tab, log.t[row])
        error = pytest.approx(log.e_y[row], abs=6e-4)
        wait_until(lambda: tab.number('#e-y') == error)
        wait_until(lambda: tab.number('#lap-time') == pytest.approx(log.lap_time[row], abs=0.051))
        car, ghost = tab.run('[cars[1], cars[Object.keys(cars).find((k) => k < 0.5)]]')
        then = laps.best.start + log.lap_time[row]
        place = [np.interp(then, log.t, each) for each in (log.x, log.y, log.psi)]
        scale = car['scale'][0]
        dx, dy = (b - a for a, b in zip(car['translate'], ghost['translate'], strict=True))
        assert (dx / scale, -dy / scale) == pytest.approx(
            (place[0] - log.x[row], place[1] - log.y[row]), abs=0.02
        )
        assert -ghost['rotate'][0] == pytest.approx(place[2], abs=0.01)

        tab.select('#axis', 't')
        for width, height, touch in SIZES:
            tab.resize(width, height, touch=touch)
            assert [*tab.overflow(), *tab.cut_labels()] == [], (width, height)


def _seek(tab: Tab, time: float) -> None:
    tab.run(
        f"(() => {{ const s = document.querySelector('#seek'); s.value = {time};"
        "s.dispatchEvent(new Event('input')); })()"
    )


AHEAD = DriverInput(1.0)
LEFT = DriverInput(0.0, 1.0)
#: By name, what happens and whether it counts: (page, input, [s], counts), or what the car must do:
#: (page, 'closes', [s], brakes), ('time', 'passes', [s], brakes).
CASES: dict[str, list[tuple[str, DriverInput | str, float, bool]]] = {
    'nothing happens until a page presses a key': [
        ('a', COAST, 0.0, False), ('time', 'passes', 9.0, False),
    ],
    'a held key, a change and a release count': [
        ('a', AHEAD, 10.0, True), ('a', AHEAD, 10.05, True), ('a', LEFT, 10.06, True),
        ('a', COAST, 10.1, True), ('time', 'passes', 20.0, False), ('a', 'closes', 20.0, False),
    ],
    'a page that closes with a key held brakes': [
        ('a', AHEAD, 0.0, True), ('a', 'closes', 0.0, True), ('time', 'passes', 9.0, False),
    ],
    'a watching page changes nothing when it closes': [
        ('a', AHEAD, 0.0, True), ('b', 'closes', 0.0, False), ('b', COAST, 0.0, False),
    ],
    'a silent page brakes, once': [
        ('a', AHEAD, 0.0, True), ('time', 'passes', STALE_AFTER, False),
        ('time', 'passes', STALE_AFTER + 0.001, True), ('time', 'passes', 9.0, False),
        ('a', 'closes', 9.0, False), ('b', LEFT, 9.0, True),
    ],
    'the keys pressed last count': [
        ('a', AHEAD, 0.0, True), ('b', LEFT, 0.1, True), ('a', COAST, 0.11, False),
        ('a', 'closes', 0.13, False), ('b', 'closes', 0.2, True),
    ],
    'a key that another page still holds does not count against one that is pressed later': [
        ('a', AHEAD, 0.0, True), ('b', FULL_BRAKE, 0.1, True), ('a', AHEAD, 0.11, False),
        ('b', COAST, 0.2, True), ('a', AHEAD, 0.21, True),
    ],
    'a key that another page still holds counts where the driving page is silent': [
        ('a', AHEAD, 0.0, True), ('b', LEFT, 0.1, True), ('a', AHEAD, 0.11, False),
        ('a', AHEAD, 0.7, True),
    ],
}  # fmt: skip


@pytest.mark.parametrize('steps', CASES.values(), ids=CASES)
def test_one_page_drives_and_the_car_brakes_without_its_driver(
    steps: list[tuple[str, DriverInput | str, float, bool]],
) -> None:
    drivers = DriverArbiter()
    for page, request, t, expected in steps:
        if isinstance(request, DriverInput):
            answer = drivers.accepts(page, request, t)
        else:
            answer = drivers.times_out(t) if page == 'time' else drivers.leave(page)
        assert answer == expected, t


@given(
    st.lists(
        st.tuples(
            st.sampled_from('ab'), st.sampled_from([AHEAD, LEFT, COAST, None]), st.floats(0.0, 0.2)
        )
    )
)
def test_the_last_command_of_silent_pages_never_moves_the_car(
    doings: list[tuple[str, DriverInput | None, float]],
) -> None:
    drivers = DriverArbiter()
    now, last = 0.0, COAST
    for page, request, later in doings:
        now += later
        if request is None:
            last = FULL_BRAKE if drivers.leave(page) else last
        elif drivers.accepts(page, request, now):
            last = request
    if drivers.times_out(now + STALE_AFTER + 0.001):
        last = FULL_BRAKE

    assert last in (COAST, FULL_BRAKE)
    assert not drivers.times_out(now + 10.0)
