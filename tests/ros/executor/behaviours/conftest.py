"""What any executor of rclpy's does: each case runs on rclpy's two executors and on ours.

With `-v`, a table shows which executor passes what.
"""

# ruff: noqa: SLF001 - rclpy has no other way to end an executor's threads.

from __future__ import annotations

import itertools
from collections import defaultdict
from functools import partial
from typing import TYPE_CHECKING

import pytest
from rclpy.context import Context
from rclpy.executors import Executor, MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.task import Future

from barc_sim.ros.executor import QuickExecutor

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    Until = Callable[[Callable[[], object]], None]
    MakeNode = Callable[[], Node]

EXECUTORS: dict[str, Callable[[Context], Executor]] = {
    'Single': lambda context: SingleThreadedExecutor(context=context),
    'Multi': lambda context: MultiThreadedExecutor(4, context=context),
    'Quick': lambda context: QuickExecutor(4, context=context),
}
#: By executor, what rclpy's own do not do, or by luck.
ALLOWED = {
    'Single': {
        'test_a_coroutine_continues_when_a_thread_completes_its_future': 'waits for an event',
        'test_a_coroutine_that_only_yields_continues': 'waits for an event',
        'test_reentrant_callbacks_overlap': 'one thread',
        'test_a_callback_that_blocks_does_not_stop_other_groups': 'one thread',
        'test_a_callback_waits_for_an_answer_to_its_call': 'one thread',
        'test_a_rate_paces_a_callback_of_another_group': 'one thread',
    },
    'Multi': {
        'test_a_coroutine_continues_when_a_thread_completes_its_future': 'waits for an event',
        'test_a_coroutine_that_only_yields_continues': 'waits for an event',
        'test_done_callbacks_run_before_later_messages': 'its threads race',
        'test_a_guard_condition_is_called_once_for_triggers_before': 'its threads race',
        'test_spin_once_executes_one_callback': 'submits a callback more than once',
        'test_a_waiting_coroutine_keeps_its_exclusive_group': 'submits a callback more than once',
        'test_a_goal_has_feedback_and_a_result': 'its threads race',
        'test_feedback_after_the_result_was_taken_is_dropped': 'its threads race',
        'test_an_exception_of_a_service_is_raised': 'its threads race',
    },
}
_numbers = itertools.count()


@pytest.fixture(scope='module')
def context(module_domain: int) -> Iterator[Context]:
    """Return the context of a module's cases."""
    context = Context()
    context.init(domain_id=module_domain)
    yield context
    context.try_shutdown()


@pytest.fixture(params=EXECUTORS)
def kind(request: pytest.FixtureRequest) -> str:
    """Return the name of each executor."""
    return str(request.param)


@pytest.fixture
def deadline(request: pytest.FixtureRequest, kind: str) -> float:
    """Return the time [s] within which the executor must do what it does.

    It is short where rclpy's own need not do it.
    """
    reason = ALLOWED.get(kind, {}).get(request.node.originalname)
    if not reason:
        return 20.0
    request.applymarker(pytest.mark.xfail(reason=reason, strict=False))
    return 0.5


@pytest.fixture
def make_executor(kind: str, deadline: float) -> Callable[[Context], Executor]:
    """Return a function that makes an executor of each kind."""
    del deadline  # it marks the case
    return EXECUTORS[kind]


@pytest.fixture
def executor(make_executor: Callable[[Context], Executor], context: Context) -> Iterator[Executor]:
    """Return an executor of each kind."""
    executor = make_executor(context)
    yield executor
    executor.shutdown()
    if isinstance(executor, MultiThreadedExecutor):
        executor._executor.shutdown()  # rclpy leaves its threads


@pytest.fixture
def make_node(context: Context, executor: Executor) -> Iterator[MakeNode]:
    """Return a function that makes nodes of one namespace in the executor."""
    namespace = f'case_{next(_numbers)}'
    nodes = []

    def make() -> Node:
        node = Node(
            f'node_{len(nodes)}',
            namespace=namespace,
            context=context,
            enable_rosout=False,
            start_parameter_services=False,
        )
        nodes.append(node)
        executor.add_node(node)
        return node

    yield make
    for node in nodes:
        executor.remove_node(node)
        node.destroy_node()


@pytest.fixture
def node(make_node: MakeNode) -> Node:
    """Return a node in the executor."""
    return make_node()


@pytest.fixture
def until(executor: Executor, spin_until: Callable[..., None], deadline: float) -> Until:
    """Return a function that spins the executor until a condition holds."""
    return partial(spin_until, executor, deadline=deadline)


@pytest.fixture
def spin_for(executor: Executor) -> Callable[[float], None]:
    """Return a function that spins the executor for some seconds."""
    return lambda seconds: executor.spin_until_future_complete(Future(), seconds)


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Print which executor passes what."""
    if terminalreporter.config.option.verbose <= 0:
        return
    results: dict[str, dict[str, str]] = defaultdict(dict)
    marks = {'passed': 'yes', 'xpassed': 'yes', 'failed': 'NO', 'xfailed': 'no', 'error': 'NO'}
    for outcome, mark in marks.items():
        for report in terminalreporter.stats.get(outcome, []):
            case, _, parameters = report.nodeid.rpartition('::')[2].partition('[')
            names = parameters.rstrip(']').split('-')
            kind = next((name for name in names if name in EXECUTORS), None)
            if kind and '/behaviours/' in report.nodeid:
                others = '-'.join(name for name in names if name != kind)
                results[f'{case}[{others}]' if others else case][kind] = mark
    if not results:
        return
    terminalreporter.section('who passes what')
    width = max(len(case) for case in results)
    terminalreporter.write_line(' ' * width + ''.join(f'{kind:>8}' for kind in EXECUTORS))
    for case, row in sorted(results.items()):
        marks_of_case = ''.join(f'{row.get(kind, "-"):>8}' for kind in EXECUTORS)
        terminalreporter.write_line(f'{case:{width}}{marks_of_case}')
    totals = [sum(row.get(kind) == 'yes' for row in results.values()) for kind in EXECUTORS]
    terminalreporter.write_line(
        f'{f"of {len(results)}":{width}}' + ''.join(f'{total:>8}' for total in totals)
    )
