"""The live page in a real browser."""

from __future__ import annotations

import math
import re
import threading
import time
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip('rclpy')

from barc_interfaces.msg import ECU, Environment, ZDynBkMdl
from browser import AXE, CHROMIUM, SIZES, wait_until
from command_line import spinning
from geometry_msgs.msg import Twist
from node_bench import overrides
from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

from barc_sim.control.lane import LaneLQR
from barc_sim.control.speed import PID
from barc_sim.errors import UserError
from barc_sim.interfaces import qos, topics
from barc_sim.interfaces.records import Command
from barc_sim.nodes.controller import CruiseController
from barc_sim.nodes.simulator import VehicleSimulator
from barc_sim.nodes.view import ViewNode
from barc_sim.page.protocol import CAR, RunFacts, Status, lap_facts, stretch_facts
from barc_sim.ros.conversions import to_header
from barc_sim.simulation.closed_loop import lap
from barc_sim.simulation.metrics import track_laps_of
from barc_sim.vehicle.bike_model import BicycleState, Vehicle, motion, step
from barc_sim.vehicle.road import Road

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from browser import Browser, Tab
    from rclpy.context import Context

    from barc_sim.simulation.metrics import Lap

    Open = Callable[..., Tab]
    Acc = tuple[ViewNode, 'Car', CruiseController]
    Teleop = tuple[ViewNode, 'Car']

pytestmark = [
    pytest.mark.skipif(CHROMIUM is None, reason="Debian's chromium is not installed"),
    pytest.mark.timeout(300),
]
#: Scripts that a test runs on the page.
PROGRAMS = Path(__file__).with_name('programs')
TS = 0.02


class Car(Node):
    """A simulator driven by `cmd_vel`, or by `ecu` where it has a road."""

    def __init__(self, context: Context, road: str) -> None:
        super().__init__('vehicle_simulator', context=context)
        car = {'road': road, 'track': '', 'l_f': 1.5, 'l_r': 1.5, 'mass': Vehicle().mass}
        self.values = car | {'distance': 180.0, 'laps': 0} | dict.fromkeys(CAR, 0.0)
        for name, value in self.values.items():
            self.declare_parameter(name, value)
        self.add_post_set_parameters_callback(
            lambda changed: self.values.update({each.name: each.value for each in changed})
        )
        self.road = Road.named(road)
        self._state = BicycleState()
        self._lock = threading.Lock()  # no step replaces a state that a test sets
        self.command = Command()
        self.paused = self.hangs = self.braking = False
        self.stops_at = math.inf  # [m] where time is paused: a slow browser then has no haste
        self.twists: list[tuple[float, float]] = []
        self._stamp = 1_700_000_000_000_000_000
        self._state_pub = self.create_publisher(ZDynBkMdl, topics.STATE, qos.DEFAULT)
        self._environment_pub = self.create_publisher(Environment, topics.ENVIRONMENT, qos.DEFAULT)
        self._ecu_pub = self.create_publisher(ECU, topics.ECU, qos.DEFAULT)
        self.create_subscription(Twist, 'cmd_vel', self._on_twist, 10)
        self.create_subscription(ECU, topics.ECU, self._on_ecu, qos.DEFAULT)
        self.create_service(Trigger, '~/reset', self._on_reset)
        self.create_service(SetBool, '~/pause', self._on_pause)
        self.create_timer(TS, self._step)

    @property
    def state(self) -> BicycleState:
        """The present state."""
        return self._state

    @state.setter
    def state(self, state: BicycleState) -> None:
        with self._lock:
            self._state = state

    def _step(self) -> None:
        self.paused |= self.state.x > self.stops_at
        if self.paused or self.hangs:
            return
        theta = self.road.grade_deg(self.state.x)
        if self.braking:
            slower = min(8.0, abs(self.state.v) / TS)
            self.command = Command(-math.copysign(slower, self.state.v))
        with self._lock:
            self._state = step(self._state, self.command, math.radians(theta), Vehicle(), TS)
        self._stamp += int(1e9 * TS)
        header = to_header(self._stamp)
        now = motion(self.state, self.command.servo, Vehicle())
        self._environment_pub.publish(
            Environment(
                header=header,
                theta=theta,
                elevation=self.road.elevation(now.x),
                gravity=-Vehicle().mass * Vehicle().gravity * math.sin(math.radians(theta)),
                drag=-1.5,
                friction=-0.25,
            )
        )
        self._state_pub.publish(ZDynBkMdl(header=header, **now._asdict()))

    def _on_twist(self, twist: Twist) -> None:
        self.twists.append((twist.linear.x, twist.angular.z))
        self.braking = twist.linear.z < 0.0
        self.command = Command(4.0 * twist.linear.x, 0.3 * twist.angular.z)
        self._ecu_pub.publish(
            ECU(header=to_header(self._stamp), motor=self.command[0], servo=self.command[1])
        )

    def _on_ecu(self, ecu: ECU) -> None:
        self.command = Command(ecu.motor, ecu.servo)

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self.state = BicycleState()
        response.success = True
        return response

    def _on_pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self.paused = request.data
        response.success = True
        return response


@contextmanager
def run(
    context: Context, mode: str, port: int = 0
) -> Iterator[tuple[ViewNode, Car, CruiseController | None]]:
    car = Car(context, 'lab' if mode == 'acc' else 'flat')
    controller = CruiseController(context=context) if mode == 'acc' else None
    run = RunFacts(
        lambda: car.values,
        controller and controller.control,
        car.road,
        status=lambda: Status(missed=2, paused=car.paused),
    )
    view = ViewNode(mode, port=port, context=context, run=run)
    with spinning(context, *(node for node in (view, car, controller) if node)):
        yield view, car, controller


@pytest.fixture
def teleop(ros: Context) -> Iterator[Teleop]:
    with run(ros, 'teleop') as (view, car, _):
        yield view, car


@pytest.fixture
def acc(ros: Context) -> Iterator[Acc]:
    with run(ros, 'acc') as (view, car, controller):
        assert controller
        yield view, car, controller


@pytest.fixture
def open_(browser: Browser) -> Iterator[Open]:
    """Return a function that opens a live page; its console must stay empty."""
    tabs: list[Tab] = []

    def open_page(url: str, **options: Any) -> Tab:  # noqa: ANN401 (Browser.open's)
        tab = browser.open(url, **options)
        tabs.append(tab)
        tab.until("document.querySelector('#time').textContent !== '\\u2013'")
        return tab

    yield open_page
    problems = [problem for tab in tabs for problem in tab.problems]
    for tab in tabs:
        tab.close()
    assert problems == []


def test_acc_shows_the_car_on_its_road(acc: Acc, open_: Open) -> None:
    view, car, _ = acc
    tab = open_(view.url)
    canvases = ('#scene', '#course', '#speed-chart', '#command-chart')
    for canvas in canvases:
        tab.remember(canvas)
    car.state, car.stops_at = BicycleState(x=22.0, v=8.0), 30.0
    wait_until(lambda: 30.0 < tab.number('#position') < 30.5 and tab.text('#grade') == '10')

    for canvas in canvases:
        assert tab.changed(canvas) > 100, canvas
    assert tab.number('#speed') == pytest.approx(8.0, abs=0.3)
    assert tab.number('#reference') == 8.0
    assert tab.text('#missed') == '2'


@pytest.mark.parametrize('mode', ['acc', 'teleop'])
def test_nothing_is_cut_at_any_size_or_on_paper_and_all_works_by_keyboard(
    ros: Context, open_: Open, mode: str
) -> None:
    with run(ros, mode) as (view, car, controller):
        car.state = BicycleState(x=100.0, v=8.0, psi=0.0 if mode == 'acc' else 0.5)
        tab = open_(view.url, width=1440, height=900)
        if controller:  # its sliders come with the answer to a request
            tab.until("document.querySelector('#kp')?.value === '30'")
        assert tab.without_keyboard() == []
        assert car.twists == []

        tab.run("document.querySelector('#goal').click()")
        cut = {}
        for width, height, touch in SIZES:
            tab.resize(width, height, touch=touch)
            cut[width, height] = [*tab.overflow(), *tab.cut_labels()]
        tab.media('print')
        tab.resize(800, 1100)
        controls = "document.querySelectorAll('.actions *, .transport *, .presets *, .pads *')"
        assert not tab.run(f'Array.from({controls}).some((e) => e.checkVisibility())')

        cut[800, 1100] = tab.overflow()
        tab.media('')
        view.page.end('The run has ended.', bag='bags/run 1')
        tab.until("!document.querySelector('#end-card').hidden")
        tab.run("document.querySelector('#end-card summary').click()")
        for width, height, touch in SIZES:
            tab.resize(width, height, touch=touch)
            cut[width, height] += tab.overflow()
        assert tab.without_keyboard() == []

    assert {size: names for size, names in cut.items() if names} == {}


def test_keys_drive_the_car_that_is_shown_while_they_are_held(teleop: Teleop, open_: Open) -> None:
    view, car = teleop
    tab = open_(view.url)
    for canvas in ('#scene', '#speed-chart'):
        tab.remember(canvas)
    tab.press('ArrowUp')
    wait_until(lambda: car.state.v > 1.0)
    assert tab.run("document.querySelector('kbd.held').dataset.held") == 'forward'

    tab.release('ArrowUp')
    wait_until(lambda: car.twists[-1] == (0.0, 0.0))
    assert set(car.twists[:-1]) == {(1.0, 0.0)}
    assert tab.run("document.querySelector('kbd.held')") is None

    wait_until(lambda: tab.number('#speed') == pytest.approx(car.state.v, abs=0.02))
    for canvas in ('#scene', '#speed-chart'):
        assert tab.changed(canvas) > 200, canvas
    assert car.twists[-1] == (0.0, 0.0)

    tab.press('ArrowUp')
    wait_until(lambda: car.twists[-1] == (1.0, 0.0))
    tab.run("dispatchEvent(new Event('blur'))")  # the page loses the focus
    wait_until(lambda: car.twists[-1] == (0.0, 0.0))


def test_the_space_key_brakes(teleop: Teleop, open_: Open) -> None:
    view, car = teleop
    tab = open_(view.url)
    tab.press('Space')
    wait_until(lambda: car.braking)
    tab.release('Space')
    wait_until(lambda: not car.braking)
    assert not car.paused  # the key is none that presses a button


def test_two_fingers_drive_and_steer(teleop: Teleop, open_: Open) -> None:
    view, car = teleop
    tab = open_(view.url, width=360, height=760, touch=True)
    (x, y), (u, v) = tab.middle('#throttle'), tab.middle('#steer')
    now = time.time()  # a thumb may move at once, and then be still
    tab.touch('touchStart', (x, y), (u, v), at=now)
    tab.touch('touchMove', (x, y - 40), (u - 40, v), at=now)
    wait_until(lambda: car.state.v > 0.5 and car.state.psi > 0.01)
    assert car.twists[-1][0] > 0.5
    assert car.twists[-1][1] > 0.5

    tab.touch('touchEnd')
    wait_until(lambda: car.twists[-1] == (0.0, 0.0))


def test_goal_counts_the_cones_that_are_touched(teleop: Teleop, open_: Open) -> None:
    view, car = teleop
    tab = open_(view.url)
    assert tab.run("document.querySelector('#goal-panel').hidden") is True

    tab.click('#goal')
    car.state = BicycleState(x=19.0)
    tab.press('ArrowUp')
    wait_until(lambda: tab.text('#goal-touched') == '1')
    tab.release('ArrowUp')
    assert tab.overflow() == []


def test_the_goals_clock_starts_when_it_is_switched_on(teleop: Teleop, open_: Open) -> None:
    view, car = teleop
    tab = open_(view.url)

    def pause() -> float:
        car.paused = True
        end = view.page.feed.laps
        wait_until(lambda: tab.text('#state') == 'Paused')
        wait_until(lambda: tab.number('#time') == pytest.approx(end.current.end, abs=0.051))
        return end.current.end

    car.state = BicycleState(v=2.0)
    wait_until(lambda: car.state.x > 1.0)
    on = pause()
    tab.click('#goal')
    car.paused = False
    wait_until(lambda: tab.number('#goal-time') > 0.2)
    duration = pytest.approx(pause() - on, abs=0.051)
    wait_until(lambda: tab.number('#goal-time') == duration)
    tab.select('#seek', 0.5 * on, 'input')  # before it was on, nothing counts
    wait_until(lambda: tab.text('#goal-time') == '0.0')
    tab.click('#play')
    wait_until(lambda: tab.number('#goal-time') == duration)


def test_sliders_work_by_keyboard_and_arrows_do_not_drive(acc: Acc, open_: Open) -> None:
    view, car, controller = acc
    tab = open_(view.url)
    tab.until("document.querySelector('#kp').value === '30'")
    tab.focus_by_tab('#kp-slider')
    tab.type('ArrowRight')
    wait_until(lambda: controller.get_parameter('kp').value == pytest.approx(30.5))
    assert car.twists == []

    tab.focus_by_tab('#pause')
    tab.press('ArrowUp')
    tab.release('ArrowUp')
    tab.type('Space')
    wait_until(lambda: car.paused and tab.text('#pause') == 'Resume')
    assert car.twists == []

    tab.select('#kd', -2e6)  # what is refused is explained, and replaced
    tab.until("document.querySelector('#tuning-note').textContent.startsWith('kd: -2e+06 is not')")
    assert tab.run("document.querySelector('#kd').value") == '0.1'
    assert controller.get_parameter('kd').value == 0.1

    tab.select('#acceleration_limit', 1e6)  # no limit, as with a user's controller
    tab.until("document.querySelector('#acceleration_limit').value === '1e+6'")
    box = "document.querySelector('#acceleration_limit')"
    assert tab.run(f'{box}.scrollWidth <= {box}.clientWidth')


def is_shown(tab: Tab, node: Node, name: str, value: float) -> bool:
    """Return whether slider, number and node have a value, and can be used."""
    values = tab.run(
        f"['{name}-slider', '{name}'].map((id) => document.getElementById(id))"
        '.map((e) => e.disabled || e.valueAsNumber)'
    )
    return [*values, node.get_parameter(name).value] == [value] * 3


def slid(tab: Tab) -> float:
    """Return where the slider of kp is."""
    return float(tab.run("document.querySelector('#kp-slider').valueAsNumber"))


def note(tab: Tab) -> str:
    return str(tab.run("document.querySelector('#tuning-note').textContent"))


def test_slider_number_and_node_agree_whichever_of_them_sets_the_value(
    acc: Acc, open_: Open
) -> None:
    view, car, controller = acc
    tab = open_(view.url)
    wait_until(lambda: is_shown(tab, controller, 'speed_reference', 8.0))

    def agree(value: float, name: str = 'speed_reference', node: Node = controller) -> None:
        wait_until(lambda: is_shown(tab, node, name, value), f'{name} {value:g}')

    tab.enter('#speed_reference', '12')
    agree(12.0)
    tab.run("document.querySelector('#speed_reference-slider').focus()")
    tab.type('ArrowRight')
    agree(12.1)
    tab.type('ArrowLeft')
    tab.type('ArrowLeft')
    agree(11.9)
    tab.enter('#speed_reference', '12.34')  # between two steps of the slider
    tab.type('ArrowUp')  # in the number
    agree(12.44)
    controller.set_parameters(overrides(speed_reference=9.0))  # as `barc param set` does
    agree(9.0)  # although the number has the focus
    tab.write('#speed_reference', '77')  # but not what is being typed
    controller.set_parameters(overrides(speed_reference=9.5))
    tab.until("document.querySelector('#speed_reference-slider').valueAsNumber === 9.5")
    assert tab.run("document.querySelector('#speed_reference').value") == '77'

    tab.run("document.querySelector('#speed_reference').blur()")
    agree(77.0)
    tab.enter('#speed_reference', '8')
    agree(8.0)

    tab.enter('#kp', '150')  # beyond the slider's usual range
    agree(150.0, 'kp')
    tab.run("document.querySelector('#kp-slider').focus()")
    tab.type('ArrowDown')
    agree(149.25, 'kp')
    tab.enter('#kp', '-2')
    agree(-2.0, 'kp')
    tab.enter('#kp', '30')
    agree(30.0, 'kp')
    for by, low, high in ((30, 30.5, 99.0), (-1000, 0.0, 0.0)):
        tab.drag('#kp-slider', by)
        wait_until(lambda low=low, high=high: low <= slid(tab) <= high)
        wait_until(lambda: is_shown(tab, controller, 'kp', slid(tab)))

    tab.enter('#motor_delay', '0.123')
    agree(0.123, 'motor_delay', car)
    tab.click('#presets button:nth-child(2)')
    for name, value in PID.presets['PI'].items():
        agree(value, name)
    agree(0.0, 'motor_delay', car)


BEYOND = [
    ('speed_reference', '-5'),
    ('speed_reference', '101'),
    ('acceleration_limit', '0'),
    ('kd', '1e10'),
    ('noise_v_x', '-1'),
    ('motor_delay', '101'),
    ('motor_limit', '-1'),
]


def test_a_number_beyond_its_limits_is_refused_with_the_sentence_of_the_command_line(
    acc: Acc, open_: Open
) -> None:
    view, car, controller = acc
    tab = open_(view.url, width=1280, height=720)
    cases = []
    for name, text in BEYOND:
        with pytest.raises(UserError) as refusal:
            view.page.run.check(name, float(text))
        cases.append((name, text, str(refusal.value)))
    not_a_number = 'kp: a number from -1e+06 to 1e+06 is expected'
    for name, text, sentence in [
        *cases,
        ('kp', '', not_a_number),
        ('ki', 'e', not_a_number.replace('kp', 'ki')),
    ]:
        node = car if name in CAR else controller
        before = node.get_parameter(name).value
        wait_until(lambda args=(tab, node, name, before): is_shown(*args))
        tab.enter(f'#{name}', text)
        wait_until(lambda sentence=sentence: note(tab) == sentence)
        wait_until(lambda args=(tab, node, name, before): is_shown(*args))
    assert tab.text('#state') == 'Live'

    bottom = tab.run("document.querySelector('#tuning-note').getBoundingClientRect().bottom")
    assert bottom <= 720


def disconnect(view: ViewNode, tab: Tab) -> None:
    tab.run_file(PROGRAMS / 'refuse_connections.js')
    page = view.page  # no page of a browser can cut its own connection
    page.call(lambda: [each.transport.abort() for each in [*page.pages]])
    tab.until(
        "document.querySelector('#state').innerText === 'Reconnecting' && 'reconnect' in window"
    )


def test_nothing_can_be_set_while_disconnected(acc: Acc, open_: Open) -> None:
    view, _, controller = acc
    tab = open_(view.url)
    wait_until(lambda: is_shown(tab, controller, 'kp', 30.0))
    usable = (
        "Array.from(document.querySelectorAll('.actions button, .tuning :is(input, button)'))"
        '.filter((e) => !e.disabled && e.checkVisibility()).map((e) => e.id || e.textContent)'
    )
    connected = tab.run(usable)
    tab.write('#kp', '77')
    disconnect(view, tab)
    assert tab.run(usable) == ['copy-command']
    assert tab.run("['kp', 'kp-slider'].map((id) => document.getElementById(id).value)") == [
        '30',
        '30',
    ]

    controller.set_parameters(overrides(kp=20.0))
    tab.run('reconnect()')
    wait_until(lambda: is_shown(tab, controller, 'kp', 20.0))
    assert tab.run(usable) == connected

    tab.enter('#kp', '25')
    wait_until(lambda: is_shown(tab, controller, 'kp', 25.0))


def test_a_key_that_is_held_while_the_connection_breaks_is_released(
    teleop: Teleop, open_: Open
) -> None:
    view, car = teleop
    tab = open_(view.url)
    tab.press('ArrowUp')
    wait_until(lambda: car.state.v > 0.5)
    disconnect(view, tab)
    assert tab.run("document.querySelector('kbd.held')") is None

    tab.press('ArrowLeft')
    assert tab.run("document.querySelector('kbd.held')") is None

    wait_until(lambda: car.braking)  # the run has noticed it, too
    twists = len(car.twists)
    tab.run('reconnect()')
    wait_until(lambda: tab.text('#state') == 'Live')
    tab.release('ArrowUp')
    tab.press('ArrowDown')
    wait_until(lambda: car.twists[-1] == (-1.0, 0.0))
    assert (1.0, 0.0) not in car.twists[twists:]


def test_a_requested_value_is_shown_until_the_node_answers(teleop: Teleop, open_: Open) -> None:
    tab = open_(teleop[0].url)
    steps = tab.run_file(PROGRAMS / 'request_parameters.js')
    assert steps['sent'] == [1, 2, 3, 4]
    assert steps['shown'] == [None, 0, 2, 2, 2, 1, 3, 1, 1]
    assert steps['notes'] == ['why', 'kp: its node has not answered within 0.3 s']


def test_presets_set_all_gains_and_the_integral_is_reset(acc: Acc, open_: Open) -> None:
    view, car, controller = acc
    car.state = BicycleState(x=22.0, v=8.0)
    tab = open_(view.url)
    tab.until("document.querySelector('#kp').value === '30'")
    names = "Array.from(document.querySelectorAll('#presets button'), (b) => b.textContent)"
    assert tab.run(names) == [*PID.presets, 'Noise', 'Delay', 'Windup']

    tab.click('#presets button:nth-child(2)')
    wait_until(lambda: tab.number('#term-integral') > 0.1)
    tab.click('#presets button')
    gains = PID.presets['P']
    wait_until(lambda: all(controller.get_parameter(k).value == v for k, v in gains.items()))
    for name, value in gains.items():
        tab.until(f"document.querySelector('#{name}').value === '{value:g}'")
    tab.click('#reset-controller')
    wait_until(lambda: tab.number('#term-integral') == 0.0)
    tab.run('navigator.clipboard.writeText = async (text) => { window.copied = text; }')

    def is_copied(command: str) -> bool:
        tab.click('#copy-command')  # again, as a slider may still show an older answer
        return bool(tab.run(f"window.copied === '{command}'"))

    command = 'barc acc --gain kp=4 --gain ki=0 --gain kd=0 --speed 8 --laps 0'
    wait_until(lambda: is_copied(command))
    tab.select('#noise_v_x', 0.25)
    wait_until(lambda: car.get_parameter('noise_v_x').value == 0.25)
    # With noise, the measured speed is another one than the speed: its line is shown.
    tab.until("document.querySelector('#speed-legend li:last-child button').ariaPressed === 'true'")
    tab.click('#presets button')  # which sets the noise, too
    wait_until(lambda: car.get_parameter('noise_v_x').value == 0.0)
    tab.select('#noise_v_x', 0.25)
    noisy = f'{command} --ros-args -p vehicle_simulator:noise_v_x:=0.25'
    wait_until(lambda: is_copied(noisy))


def test_the_page_shows_the_forces_and_terms_of_the_messages(acc: Acc, open_: Open) -> None:
    view, car, _ = acc
    car.state, car.stops_at = BicycleState(x=22.0, v=8.0), 34.0
    tab = open_(view.url)
    wait_until(lambda: car.paused)
    wait_until(lambda: tab.number('#position') == pytest.approx(car.state.x, abs=0.1))
    gravity = -Vehicle().mass * Vehicle().gravity * math.sin(math.radians(10.0))
    wait_until(lambda: tab.number('#force-gravity') == round(gravity))
    assert (tab.number('#force-drag'), tab.number('#force-friction')) == (-1.5, -0.25)

    texts = tab.run(
        "['#force-motor', '#term-motor', '#term-proportional', '#term-integral', "
        "'#term-derivative'].map((id) => document.querySelector(id).textContent)"
    )
    force, command, *terms = (float(text.replace('\N{MINUS SIGN}', '-')) for text in texts)
    assert force == pytest.approx(Vehicle().mass * command, rel=0.01)
    assert command == pytest.approx(sum(terms), abs=0.002)


def test_a_stalled_run_is_shown_with_its_seconds_and_few_announcements(
    acc: Acc, open_: Open
) -> None:
    view, car, _ = acc
    tab = open_(view.url)
    tab.until("document.querySelector('#state').innerText === 'Live'")
    tab.run_file(PROGRAMS / 'count_announcements.js')
    began = time.monotonic()
    wait_until(lambda: time.monotonic() > began + 1.0)  # readings change all the time
    car.hangs = True
    stalled = time.monotonic()
    seconds = 0

    def is_counted() -> bool:
        nonlocal seconds
        match = re.fullmatch(r'No data for (\d+) s', tab.text('#state'))
        seconds = int(match[1]) if match else 0
        return seconds >= 2

    wait_until(is_counted)
    assert seconds <= time.monotonic() - stalled + 0.1
    changes = tab.run('Object.values(announced)')
    assert all(count <= time.monotonic() - began for count in changes)
    car.hangs = False
    wait_until(lambda: tab.text('#state') == 'Live')


def test_reset_begins_a_lap_and_the_last_one_stays_as_a_ghost(acc: Acc, open_: Open) -> None:
    view, car, _ = acc
    car.state = BicycleState(x=11.0, v=8.0)
    tab = open_(view.url)
    wait_until(lambda: tab.number('#position') > 14.0)
    before = view.page.feed.laps.current.number  # the car may have driven before it was placed
    tab.click('#reset')
    wait_until(lambda: view.page.feed.laps.current.number > before)
    last = "document.querySelector('[data-figure=rms] td:nth-of-type(2)').textContent"
    rms = lap_facts(view.page.feed.laps)['last']['rms']
    tab.until(f'Math.abs({last} - {rms}) < 6e-4')
    # The lap in the chart is broken at the reset: its states have another number.
    laps = lap_facts(view.page.feed.laps)

    assert laps['current']['start'] == pytest.approx(laps['last']['end'] + TS)


def test_an_earlier_state_is_shown_beside_the_laps_of_its_time(acc: Acc, open_: Open) -> None:
    view, car, controller = acc
    laps = view.page.feed.laps
    tab = open_(view.url)
    wait_until(lambda: is_shown(tab, controller, 'kp', 30.0))
    for speed, gain in ((6.0, 30.0), (7.0, 20.0), (8.0, 10.0)):
        number = laps.number
        controller.set_parameters(overrides(kp=gain))
        car.state = BicycleState(x=11.0, v=speed)  # a jump begins a lap
        wait_until(lambda number=number: laps.number > number and laps.current.length > 4.0)
        wait_until(lambda gain=gain: f'kp {gain:g}, ' in tab.text('#lap-gains'))
    car.paused = True
    wait_until(lambda: tab.text('#state') == 'Paused')

    def rms(lap: Lap) -> str:
        return f'{lap.summary.rms_error_after_run_up:.3f}'

    cells = "Array.from(document.querySelectorAll('[data-figure=rms] td'), (c) => c.textContent)"
    first, second, third = [*laps][-3:]
    for each, before in ((third, second), (second, first)):
        tab.select('#seek', 0.5 * (each.start + each.end), 'input')
        texts = [rms(each), rms(before)]
        wait_until(lambda texts=texts: tab.run(cells)[:2] == texts)
    gains = tab.text('#lap-gains')
    assert 'kp 20, ' in gains.partition('this lap: ')[2]
    assert 'kp 10, ' not in gains.partition('this lap: ')[2]

    tab.click('#play')  # back to live
    wait_until(lambda: tab.run(cells)[0] == rms(third))


def test_the_parameters_of_an_earlier_state_are_those_of_its_time(
    teleop: Teleop, open_: Open
) -> None:
    tab = open_(teleop[0].url)
    limits = tab.run_file(PROGRAMS / 'settings_over_time.js')
    assert limits == [None, [0, 6, 6, 7, 7], 8, 6]


HEADINGS = {0.3: 0, -179.7: 180, 179.7: 180, -179.4: -179, 359.6: 0, 540.0: 180, -90.0: -90}


def test_a_heading_is_shown_between_minus_179_and_180_degrees(teleop: Teleop, open_: Open) -> None:
    view, car = teleop
    tab = open_(view.url)
    for degrees, reading in HEADINGS.items():
        car.state = BicycleState(psi=math.radians(degrees))
        wait_until(lambda reading=reading: tab.number('#heading') == reading, f'heading {degrees}')


def test_buttons_pause_and_reset_the_run(teleop: Teleop, open_: Open) -> None:
    view, car = teleop
    car.state = BicycleState(x=50.0)
    tab = open_(view.url)
    tab.click('#pause')
    wait_until(lambda: car.paused)
    wait_until(lambda: tab.text('#state') == 'Paused')
    assert tab.text('#pause') == 'Resume'

    tab.click('#pause')
    wait_until(lambda: not car.paused)
    tab.click('#reset')
    wait_until(lambda: car.state.x == 0.0)
    wait_until(lambda: tab.text('#place') == '0.0, 0.0')
    tab.press('KeyP')
    tab.release('KeyP')
    wait_until(lambda: car.paused)


def test_end_card_has_the_score_and_the_next_commands(acc: Acc, open_: Open) -> None:
    view, car, _ = acc
    car.state, car.stops_at = BicycleState(x=16.0, v=8.0), 22.0
    tab = open_(view.url, width=1440, height=900)
    tab.until("document.querySelector('#kp').value === '30'")
    wait_until(lambda: tab.text('#state') == 'Paused')
    view.page.end('The run has ended: Ctrl-C was pressed.', bag='bags/my run')
    tab.until("!document.querySelector('#end-card').hidden")
    laps, stretches = lap_facts(view.page.feed.laps), stretch_facts(view.page.feed.laps.current)
    tab.click('#end-card summary')
    card = tab.text('#end-card')

    assert f'{laps["current"]["rms"]:.3f} m/s' in card
    assert f'{stretches[1]["max_error"]:.3f}' in card
    assert 'barc acc --gain kp=30 --gain ki=200 --gain kd=0.1 --speed 8 --laps 0' in card
    assert "barc replay 'bags/my run'" in card
    assert tab.text('#message') == 'The run has ended: Ctrl-C was pressed.'
    assert tab.text('#state') == 'Ended'
    assert tab.run("document.querySelector('#reset').disabled") is True
    assert tab.overflow() == []


def test_history_of_a_day_has_bounded_memory_and_keeps_its_beginning(
    teleop: Teleop, open_: Open
) -> None:
    view, _ = teleop
    tab = open_(view.url)
    count, first, last, laps = tab.run_file(PROGRAMS / 'history_of_a_day.js')
    assert count <= 1000
    assert (first, last) == (0.0, pytest.approx(0.02 * 19999))
    assert laps == pytest.approx([100.0, 200.0, 300.0])


def test_page_reports_a_lost_connection_and_reconnects(teleop: Teleop, open_: Open) -> None:
    view, car = teleop
    tab = open_(view.url)
    tab.run(
        'new MutationObserver(() => { window.shown ||= '
        "document.querySelector('#message').textContent; })"
        ".observe(document.querySelector('#message'), {childList: true})"
    )
    page = view.page  # no page of a browser can cut its own connection
    page.call(lambda: [each.transport.abort() for each in [*page.pages]])
    tab.until("(window.shown ?? '').startsWith('The connection to the run was lost')")
    wait_until(lambda: tab.text('#state') == 'Live')
    assert tab.run("document.querySelector('#message').hidden") is True

    car.state = BicycleState(x=33.0)
    wait_until(lambda: tab.text('#place').startswith('33'))


@pytest.fixture(params=['acc', 'teleop'])
def either(ros: Context, request: pytest.FixtureRequest) -> Iterator[ViewNode]:
    with run(ros, request.param) as (view, _, _):
        yield view


@pytest.mark.skipif(not AXE.is_file(), reason='axe-core is not installed (AXE_CORE names it)')
def test_axe_finds_no_violation_of_accessibility(either: ViewNode, open_: Open) -> None:
    tab = open_(either.url, width=1440, height=900)

    def violations_in_all_themes() -> list[str]:
        kinds = []
        for dark in (True, False):
            tab.dark(on=dark)
            kinds += tab.violations(AXE)
        return kinds

    assert violations_in_all_themes() == []

    tab.resize(360, 760, touch=True)
    assert violations_in_all_themes() == []

    either.page.end('The run has ended.', bag='bags/run 1')
    tab.until("!document.querySelector('#end-card').hidden")
    assert violations_in_all_themes() == []

    tab.media(forced_colors='active')
    assert tab.violations(AXE) == []

    tab.resize(1440, 900)
    assert tab.overflow() == []


def test_the_page_shows_the_laps_of_a_track_as_the_log_has_them(ros: Context, open_: Open) -> None:
    parameters = {'track': 'circle', 'laps': 3, 'realtime_factor': 20.0}
    controller = CruiseController(
        context=ros, parameter_overrides=overrides(track='circle', speed_reference=10.0)
    )
    simulator = VehicleSimulator(context=ros, parameter_overrides=overrides(**parameters))
    run = RunFacts(lambda: simulator.values, controller.control, track=simulator.track)
    view = ViewNode(context=ros, run=run)
    with spinning(ros, view, simulator, controller):
        tab = open_(view.url)
        tab.until("document.body.dataset.mode === 'track'")
        tab.run_file(PROGRAMS / 'count_announcements.js')
        began = time.monotonic()
        tab.until("document.querySelectorAll('#track-laps tr').length === 3")
        tab.until("document.querySelector('#track-laps tr:last-child td').textContent !== '\u2013'")
        cells = (
            "Array.from(document.querySelectorAll('#track-laps td'), (c) => Number(c.textContent))"
        )
        log = lap(LaneLQR(), 'circle', speed=10.0, laps=3)
        laps, _ = track_laps_of(log)
        expected = [
            value
            for each in laps.finished
            for value in (each.time, each.rms, each.maximum, 100.0 * each.at_limit)
        ]
        assert tab.run(cells) == pytest.approx(expected, abs=0.006)

        wait_until(lambda: tab.number('#e-y') == pytest.approx(log.e_y[-1], abs=6e-4))
        assert tab.number('#e-psi') == pytest.approx(math.degrees(log.e_psi[-1]), abs=0.06)
        assert tab.number('#term-servo') == pytest.approx(math.degrees(log.servo[-1]), abs=6e-4)
        # The chart and its legend have the unit of all other angles, too.
        assert tab.text('#command-heading') == 'Error e_psi °'

        legend = tab.text('#command-legend').replace('\N{MINUS SIGN}', '-').split()
        assert legend[::2] == ['e_psi', 'steering']

        numbers = [float(value) for value in legend[1::2]]
        expected = [math.degrees(each[-1]) for each in (log.e_psi, log.servo)]
        assert numbers == pytest.approx(expected, abs=6e-4)

        seconds = time.monotonic() - began
        assert all(count <= seconds + 1.0 for count in tab.run('Object.values(announced)'))

        tab.until("document.getElementById('lane.q_e_y').value === '0.05'")
        tab.select('[id="lane.q_e_y"]', 0.25)
        wait_until(lambda: controller.get_parameter('lane.q_e_y').value == 0.25)
        tab.run('navigator.clipboard.writeText = async (text) => { window.copied = text; }')
        tab.until("document.getElementById('lane.q_e_y').value === '0.25'")
        tab.click('#copy-command')
        tab.until('window.copied')
        assert tab.run('copied') == (
            'barc acc --lane-gain q_e_y=0.25 --lane-gain q_e_psi=0.2 --lane-gain preview=0 '
            '--speed 10 --track circle --lane lqr --laps 3'
        )

        view.page.end('The run has ended.', bag='bags/run 1')
        tab.until("!document.querySelector('#end-card').hidden")
        assert laps.best
        assert f'{laps.best.time:.2f} s' in tab.text('#end-card')
