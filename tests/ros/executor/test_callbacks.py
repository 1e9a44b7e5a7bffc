"""Callback groups, coroutines and exceptions: rclpy's promises are kept, nothing is starved."""

from __future__ import annotations

import ctypes
import platform
import struct
import threading
import time
import traceback
from contextlib import suppress
from itertools import pairwise
from typing import TYPE_CHECKING

import pytest
from builtin_interfaces.msg import Time
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.task import Future
from std_srvs.srv import Empty

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rclpy.callback_groups import CallbackGroup
    from rclpy.node import Node

    from barc_sim.ros.executor import QuickExecutor

    Until = Callable[[Callable[[], object]], None]


pytestmark = pytest.mark.timeout(300)
DEPTH = 1000
DEADLINE = 100.0
GROUPS = pytest.mark.parametrize(
    'group_type', [ReentrantCallbackGroup, MutuallyExclusiveCallbackGroup]
)
TASKS = pytest.mark.usefixtures('rclpys_tasks')


class Overlap:
    """Counts how many callbacks run at the same time, at most."""

    def __init__(self) -> None:
        self.most = 0
        self._running = 0
        self._lock = threading.Lock()
        self._never = threading.Event()

    def __enter__(self) -> None:
        """Begin a callback."""
        with self._lock:
            self._running += 1
            self.most = max(self.most, self._running)
        self._never.wait(0.0005)  # lets another thread in, if any is to come

    def __exit__(self, *_: object) -> None:
        """End it."""
        with self._lock:
            self._running -= 1


def test_callbacks_of_an_exclusive_group_never_overlap(node: Node, until: Until) -> None:
    group = MutuallyExclusiveCallbackGroup()
    overlap = Overlap()
    received: dict[str, list[int]] = {topic: [] for topic in 'abc'}
    ticks = []

    def subscribe(topic: str) -> None:
        def receive(message: Time) -> None:
            with overlap:
                received[topic].append(message.sec)

        node.create_subscription(Time, topic, receive, DEPTH, callback_group=group)

    def tick() -> None:
        with overlap:
            ticks.append(1)

    publishers = [node.create_publisher(Time, topic, DEPTH) for topic in received]
    for topic in received:
        subscribe(topic)
    node.create_timer(0.001, tick, callback_group=group)
    for number in range(100):
        for publisher in publishers:
            publisher.publish(Time(sec=number))

    until(lambda: all(len(each) == 100 for each in received.values()) and len(ticks) > 20)

    assert overlap.most == 1
    assert all(each == list(range(100)) for each in received.values())


@GROUPS
def test_short_callbacks_of_all_groups_run_in_one_thread(
    node: Node, executor: QuickExecutor, group_type: type[CallbackGroup]
) -> None:
    """No other thread is woken for them, though one may take over now and then."""
    threads: list[int] = []
    done = Future()

    def note(message: Time) -> None:
        threads.append(threading.get_ident())
        publisher.publish(message)
        if len(threads) == 4000:
            done.set_result(None)

    for topic in 'ab':
        node.create_subscription(Time, topic, note, DEPTH, callback_group=group_type())
    publisher = node.create_publisher(Time, 'a', DEPTH)
    node.create_publisher(Time, 'b', DEPTH).publish(Time())
    executor.spin_until_future_complete(done, DEADLINE)

    switches = sum(a != b for a, b in pairwise(threads))
    assert done.done()
    assert switches < len(threads) / 20


@pytest.mark.parametrize('lasting', ['sleeps', 'computes'])
@pytest.mark.parametrize('spun', ['for ever', 'once', 'once, in a time'])
def test_other_callbacks_run_while_one_lasts(
    node: Node, executor: QuickExecutor, lasting: str, spun: str
) -> None:
    enough = threading.Event()
    done = Future()
    ticks = []

    def block() -> None:
        blocker.cancel()
        end = time.monotonic() + DEADLINE
        while lasting == 'computes' and not enough.is_set() and time.monotonic() < end:
            pass
        done.set_result(enough.wait(DEADLINE))

    def tick() -> None:
        ticks.append(1)
        if len(ticks) == 20:
            enough.set()

    blocker = node.create_timer(0.001, block, callback_group=MutuallyExclusiveCallbackGroup())
    node.create_timer(0.001, tick, callback_group=MutuallyExclusiveCallbackGroup())

    if spun == 'for ever':
        executor.spin_until_future_complete(done, DEADLINE)
    while not done.done():
        executor.spin_once(DEADLINE if 'time' in spun else None)

    assert done.result()


def test_other_callbacks_run_beside_the_first_call_that_lasts(
    node: Node, executor: QuickExecutor
) -> None:
    enough = threading.Event()
    done = Future()
    floods = []

    def keep_flooding(message: Time) -> None:
        floods.append(message)
        if len(floods) == 500:  # the executor is busy by then
            blocker.trigger()
        elif len(floods) == 1000:
            enough.set()
        publisher.publish(message)

    blocker = node.create_guard_condition(
        lambda: done.set_result(enough.wait(DEADLINE)),
        callback_group=MutuallyExclusiveCallbackGroup(),
    )
    publisher = node.create_publisher(Time, 'flood', DEPTH)
    node.create_subscription(Time, 'flood', keep_flooding, DEPTH)
    publisher.publish(Time())
    executor.spin_until_future_complete(done, 2 * DEADLINE)

    assert done.result()


def test_the_executors_threads_have_short_time_slices(node: Node, until: Until) -> None:
    """As Linux itself tells it, see sched_setattr(2); their children have slices as usual."""

    def time_slice() -> int:
        found = ctypes.create_string_buffer(48)
        number = 315 if platform.machine() == 'x86_64' else 275
        assert ctypes.CDLL(None).syscall(number, 0, found, len(found), 0) == 0
        return int(struct.unpack('IIQiIQQQ', found.raw)[5])

    def compare() -> None:
        slices.append(time_slice())
        child = threading.Thread(target=lambda: slices.append(time_slice()))
        child.start()
        child.join()

    usual, slices = time_slice(), []
    if not usual:
        pytest.skip('Linux has no slices of a thread here (before 6.12)')
    node.create_timer(0.001, compare)
    until(lambda: slices[1:])

    assert slices[:2] == [100_000, usual]


def test_no_more_callbacks_overlap_than_there_are_threads(
    node: Node, executor: QuickExecutor, until: Until
) -> None:
    overlap = Overlap()
    release = threading.Event()
    begun = []
    done = Future()

    def block() -> None:
        with overlap:
            begun.append(1)
            release.wait(DEADLINE)

    def end() -> None:
        release.set()
        done.set_result(None)

    for _ in range(8):
        guard = node.create_guard_condition(block, callback_group=ReentrantCallbackGroup())
        guard.trigger()
    enough = threading.Timer(0.3, end)  # by then a fifth would have begun
    enough.start()
    executor.spin_until_future_complete(done, DEADLINE)
    until(lambda: len(begun) == 8)
    enough.join()

    assert overlap.most == 4


def test_a_reentrant_callback_overlaps_itself_once_it_lasts(
    node: Node, executor: QuickExecutor
) -> None:
    meeting = threading.Barrier(3, timeout=DEADLINE)
    done = Future()

    def receive(_: Time) -> None:
        if meeting.wait() == 0:
            done.set_result(None)

    node.create_subscription(Time, 'a', receive, DEPTH, callback_group=ReentrantCallbackGroup())
    publisher = node.create_publisher(Time, 'a', DEPTH)
    for _ in range(3):
        publisher.publish(Time())

    executor.spin_until_future_complete(done, DEADLINE)

    assert done.done()


@GROUPS
def test_a_flood_starves_neither_timers_nor_other_topics_of_its_group(
    node: Node, until: Until, group_type: type[CallbackGroup]
) -> None:
    group = group_type()
    publisher = node.create_publisher(Time, 'flood', DEPTH)
    floods = []
    ticks = []
    heard = []

    def keep_flooding(message: Time) -> None:
        floods.append(message)
        publisher.publish(message)

    node.create_subscription(Time, 'flood', keep_flooding, DEPTH, callback_group=group)
    node.create_subscription(Time, 'quiet', heard.append, DEPTH, callback_group=group)
    node.create_timer(0.001, lambda: ticks.append(1), callback_group=group)
    for _ in range(10):
        publisher.publish(Time())
    node.create_publisher(Time, 'quiet', DEPTH).publish(Time())

    until(lambda: len(ticks) >= 5 and heard and len(floods) > 20)


def test_entities_that_are_ready_together_run_in_rclpys_order(
    node: Node, executor: QuickExecutor, until: Until
) -> None:
    group = MutuallyExclusiveCallbackGroup()
    calls: list[str] = []

    def serve(_: Empty.Request, response: Empty.Response) -> Empty.Response:
        calls.append('request')
        return response

    service = node.create_service(Empty, 'serve', serve, callback_group=group)
    node.create_subscription(Time, 'a', lambda _: calls.append('message'), 10, callback_group=group)
    executor.spin_once(timeout_sec=0)
    group.beginning_execution(service)
    node.create_client(Empty, 'serve').call_async(Empty.Request())
    executor.spin_once(timeout_sec=0)
    node.create_publisher(Time, 'a', 10).publish(Time())
    executor.spin_once(timeout_sec=0)
    group.ending_execution(service)
    until(lambda: len(calls) == 2)

    assert calls == ['message', 'request']


def test_actions_and_timers_do_not_starve_the_others(node: Node, executor: QuickExecutor) -> None:
    group = MutuallyExclusiveCallbackGroup()
    requests: list[Empty.Request] = []
    publisher = node.create_publisher(Time, 'a', 10)
    node.create_subscription(Time, 'a', publisher.publish, 10, callback_group=group)

    def serve(request: Empty.Request, response: Empty.Response) -> Empty.Response:
        requests.append(request)
        return response

    node.create_service(Empty, 'serve', serve, callback_group=group)
    client = node.create_client(Empty, 'serve')
    publisher.publish(Time())
    executor.spin_once(timeout_sec=DEADLINE)
    for number in range(3):
        client.call_async(Empty.Request())
        for _ in range(4):
            executor.spin_once(timeout_sec=DEADLINE)
        assert len(requests) > number


def test_messages_wait_in_the_middleware_while_the_pool_is_busy(
    node: Node, executor: QuickExecutor, until: Until
) -> None:
    release = threading.Event()
    blocked = []
    received = []

    def block() -> None:
        blocked.append(1)
        release.wait(DEADLINE)

    for _ in range(4):  # as many as there are threads
        executor.create_task(block)
    node.create_subscription(
        Time,
        'a',
        lambda message: received.append(message.sec),
        1,
        callback_group=ReentrantCallbackGroup(),
    )
    publisher = node.create_publisher(Time, 'a', 1)
    until(lambda: len(blocked) == 4)

    for number in range(50):
        publisher.publish(Time(sec=number))
        executor.spin_once(timeout_sec=0)
    release.set()
    until(lambda: 49 in received)

    assert len(received) <= 3, 'the depth of 1 was not kept to'


@pytest.mark.parametrize('keeper', ['a callback', 'something else'])
def test_messages_that_must_wait_do_not_keep_the_executor_busy(
    node: Node, executor: QuickExecutor, until: Until, keeper: str
) -> None:
    release, begun = threading.Event(), threading.Event()
    group = MutuallyExclusiveCallbackGroup()
    guard = node.create_guard_condition(
        lambda: (begun.set(), release.wait(DEADLINE)), callback_group=group
    )
    if keeper == 'a callback':
        guard.trigger()
        until(begun.is_set)
    else:
        assert group.beginning_execution(guard)
    received: list[Time] = []
    node.create_subscription(Time, 'a', received.append, DEPTH, callback_group=group)
    publisher = node.create_publisher(Time, 'a', DEPTH)
    for _ in range(3):
        publisher.publish(Time())
        executor.spin_once(timeout_sec=0)

    processor = time.process_time()
    executor.spin_once(timeout_sec=0.2)
    processor = time.process_time() - processor
    assert not received
    release.set()
    if keeper == 'something else':
        group.ending_execution(guard)
    until(lambda: len(received) == 3)

    assert processor < 0.1


class PausedGroup(ReentrantCallbackGroup):
    """Executes nothing for the time being."""

    paused = True

    def can_execute(self, entity: object) -> bool:
        """Return whether it isn't paused."""
        return not self.paused and super().can_execute(entity)


def test_a_users_callback_group_decides_what_can_run(
    node: Node, executor: QuickExecutor, until: Until
) -> None:
    group = PausedGroup()
    heard = []
    node.create_subscription(Time, 'a', heard.append, DEPTH, callback_group=group)
    node.create_publisher(Time, 'a', DEPTH).publish(Time())
    for _ in range(5):
        executor.spin_once(timeout_sec=0)
    assert heard == []

    group.paused = False
    until(lambda: heard)


@TASKS
@GROUPS
def test_a_callback_waits_for_a_future_of_another_callback(
    node: Node, executor: QuickExecutor, until: Until, group_type: type[CallbackGroup]
) -> None:
    future = Future(executor=executor)
    results = []

    async def wait() -> None:
        waiter.cancel()
        results.append(await future)

    def fulfil() -> None:
        other.cancel()
        future.set_result('done')

    waiter = node.create_timer(0.001, wait, callback_group=group_type())
    other = node.create_timer(0.01, fulfil, callback_group=group_type())

    until(lambda: results)

    assert results == ['done']


@TASKS
def test_tasks_run_and_wait_for_one_another(executor: QuickExecutor, until: Until) -> None:
    async def double(future: Future) -> int:
        return 2 * await future

    first = executor.create_task(lambda: 1)
    second = executor.create_task(double, first)
    third = executor.create_task(double, second)

    until(third.done)

    assert third.result() == 4


def test_a_future_that_is_done_during_a_step_resumes_its_coroutine(
    node: Node, executor: QuickExecutor
) -> None:
    stepping = threading.Event()
    come = threading.Event()
    noticed = threading.Event()

    class Late:
        def __await__(self) -> Iterator[None]:
            while not come.is_set():
                stepping.set()
                noticed.wait(20.0)
                time.sleep(0.05)  # the executor waits again by now
                yield

    async def wait() -> str:
        await Late()
        return 'come'

    guard = node.create_guard_condition(
        noticed.set, callback_group=MutuallyExclusiveCallbackGroup()
    )

    def come_late() -> None:
        stepping.wait(20.0)
        come.set()
        guard.trigger()

    thread = threading.Thread(target=come_late)
    thread.start()
    task = executor.create_task(wait)
    executor.spin_until_future_complete(task, 20.0)
    thread.join()

    assert task.result() == 'come'


@TASKS
def test_a_waiting_coroutine_is_not_stepped_without_an_event(executor: QuickExecutor) -> None:
    future = Future()
    done = Future()

    async def wait() -> None:
        await future

    tasks = [executor.create_task(wait) for _ in range(2)]
    executor.spin_until_future_complete(done, 0.05)
    steps = []
    for task in tasks:
        task.executing = lambda: steps.append(1)  # asked before each step
    executor.spin_until_future_complete(done, 0.3)

    assert not any(task.done() for task in tasks)
    assert steps == []


def test_tasks_that_create_tasks_starve_no_timer_and_no_deadline(
    executor: QuickExecutor, node: Node
) -> None:
    end = time.monotonic() + DEADLINE
    ticks = []
    node.create_timer(0.01, lambda: ticks.append(1))

    def go_on() -> None:
        if time.monotonic() < end:
            executor.create_task(go_on)

    go_on()
    executor.spin_until_future_complete(Future(), 0.3)
    ticked = len(ticks)
    while len(ticks) < ticked + 2 and time.monotonic() < end:
        executor.spin_once(0.1)

    assert ticked >= 2
    assert time.monotonic() < end


@TASKS
def test_a_coroutine_continues_after_a_future_that_has_no_executor(
    executor: QuickExecutor,
) -> None:
    future = Future()

    async def wait() -> int:
        return await future

    task = executor.create_task(wait)
    executor.spin_once(0.01)
    future.set_result(1)
    for _ in range(10):
        executor.spin_once(0.01)

    assert task.done()


@TASKS
def test_an_action_is_served_with_feedback_and_can_be_cancelled(
    make_node: Callable[..., Node], until: Until
) -> None:
    fibonacci = pytest.importorskip('test_msgs.action').Fibonacci
    action = pytest.importorskip('rclpy.action')
    going_on = threading.Event()

    def execute(goal: action.server.ServerGoalHandle) -> object:
        goal.publish_feedback(fibonacci.Feedback(sequence=[0, 1]))
        if goal.request.order < 0:
            while not goal.is_cancel_requested:
                going_on.wait(0.001)
            goal.canceled()
        else:
            goal.succeed()
        return fibonacci.Result(sequence=[goal.request.order])

    server = action.ActionServer(
        make_node('server'),
        fibonacci,
        'fibonacci',
        execute,
        cancel_callback=lambda _: action.CancelResponse.ACCEPT,
    )
    client = action.ActionClient(make_node('client'), fibonacci, 'fibonacci')
    feedback = []
    assert client.wait_for_server(20.0)

    def send(order: int) -> object:
        future = client.send_goal_async(
            fibonacci.Goal(order=order), lambda message: feedback.append(message.feedback)
        )
        until(future.done)
        assert future.result().accepted
        return future.result()

    result = send(3).get_result_async()
    until(lambda: result.done() and feedback)
    assert list(result.result().result.sequence) == [3]

    endless = send(-1)
    until(lambda: len(feedback) == 2)
    cancelled = endless.cancel_goal_async()
    result = endless.get_result_async()
    until(lambda: cancelled.done() and result.done())
    assert list(result.result().result.sequence) == [-1]
    client.destroy()
    server.destroy()


class BrokenError(Exception):
    """What the callbacks of these tests raise."""


def break_down(*_: object) -> None:
    raise BrokenError


async def break_down_awaiting(*_: object) -> None:
    raise BrokenError


def spin_until_broken(executor: QuickExecutor) -> list[str]:
    """Spin; return the names of the functions in the traceback."""
    with pytest.raises(BrokenError) as raised:
        executor.spin()
    return [frame.name for frame in traceback.extract_tb(raised.value.__traceback__)]


def after_waiting_for_a_future(node: Node, executor: QuickExecutor) -> None:
    future = executor.create_task(lambda: None)

    async def wait_and_break_down() -> None:
        await future
        break_down()

    node.create_guard_condition(wait_and_break_down).trigger()


def in_a_task_beside_busy_callbacks(node: Node, executor: QuickExecutor) -> None:
    guard = node.create_guard_condition(lambda: guard.trigger())  # noqa: PLW0108
    guard.trigger()
    executor.create_task(break_down)


def while_nothing_else_is_ready(node: Node, _: QuickExecutor) -> None:
    waits = threading.Event()
    node.create_timer(1e-3, lambda: (waits.wait(0.05), break_down()))


@TASKS
@pytest.mark.parametrize(
    'begin',
    [
        lambda node, _: node.create_timer(0.001, break_down),
        lambda node, _: node.create_timer(0.001, break_down_awaiting),
        after_waiting_for_a_future,
        in_a_task_beside_busy_callbacks,
        while_nothing_else_is_ready,
    ],
    ids=['a timer', 'a coroutine', 'a future', 'a task', 'alone'],
)
def test_an_exception_ends_the_spin(
    node: Node, executor: QuickExecutor, begin: Callable[[Node, QuickExecutor], None]
) -> None:
    begin(node, executor)
    assert spin_until_broken(executor)[-1].startswith('break_down')


@pytest.mark.parametrize('error', [SystemExit, KeyboardInterrupt])
def test_a_base_exception_ends_the_spin(
    executor: QuickExecutor, error: type[BaseException]
) -> None:
    def end() -> None:
        raise error

    executor.create_task(end)
    with pytest.raises(error):
        executor.spin()


@GROUPS
def test_an_exception_leaves_the_executor_and_the_group_usable(
    node: Node, executor: QuickExecutor, until: Until, group_type: type[CallbackGroup]
) -> None:
    group = group_type()
    timer = node.create_timer(0.001, break_down, callback_group=group)
    spin_until_broken(executor)
    timer.cancel()
    for _ in range(10):  # further calls that had been handed off
        with suppress(BrokenError):
            executor.spin_once(timeout_sec=0)

    ticks = []
    node.create_timer(0.001, lambda: ticks.append(1), callback_group=group)
    until(lambda: ticks)


def test_one_exception_of_many_is_raised_by_each_spin(executor: QuickExecutor, node: Node) -> None:
    node.create_subscription(Time, 'a', break_down, 10)
    publisher = node.create_publisher(Time, 'a', 10)
    for _ in range(3):
        publisher.publish(Time())
    for _ in range(3):
        spin_until_broken(executor)
    executor.spin_once(timeout_sec=0)
