"""Services, clients, parameters of other nodes, and actions."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Any

import pytest
from rcl_interfaces.msg import ParameterType
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.task import Future
from std_srvs.srv import SetBool

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from rclpy.client import Client
    from rclpy.context import Context
    from rclpy.executors import Executor

    Until = Callable[[Callable[[], object]], None]

pytestmark = pytest.mark.timeout(60)
DEADLINE = 20.0


def answer(request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
    """Answer a request with its data."""
    response.success = request.data
    return response


@pytest.fixture
def client(make_node: Callable[[], Node], until: Until) -> Client:
    """Return a client of a service that answers."""
    make_node().create_service(SetBool, 'set', answer)
    client = make_node().create_client(SetBool, 'set')
    until(client.service_is_ready)
    return client


def test_each_request_gets_its_own_answer(client: Client, until: Until) -> None:
    wanted = [number % 3 == 0 for number in range(8)]  # a service keeps 10
    futures = [client.call_async(SetBool.Request(data=data)) for data in wanted]
    until(lambda: all(future.done() for future in futures))
    assert [future.result().success for future in futures] == wanted


def test_a_done_callback_gets_the_answer(client: Client, until: Until) -> None:
    called: list[Future] = []
    future = client.call_async(SetBool.Request(data=True))
    future.add_done_callback(called.append)
    until(lambda: called)
    assert called == [future]
    assert future.result().success


def test_removed_and_cancelled_requests_get_no_response(client: Client, until: Until) -> None:
    removed = client.call_async(SetBool.Request())
    client.remove_pending_request(removed)
    cancelled = client.call_async(SetBool.Request())
    cancelled.cancel()
    last = client.call_async(SetBool.Request(data=True))
    until(last.done)
    assert not removed.done()
    assert cancelled.cancelled()


def test_a_thread_calls_and_waits(executor: Executor, client: Client) -> None:
    answers: list[Any] = []
    done = Future(executor=executor)

    def call() -> None:
        answers.append(client.call(SetBool.Request(data=True)))
        done.set_result(1)

    thread = threading.Thread(target=call, daemon=True)
    thread.start()
    executor.spin_until_future_complete(done, DEADLINE)
    thread.join(DEADLINE)
    assert answers[0].success


def test_a_callback_waits_for_an_answer_to_its_call(
    executor: Executor, client: Client, node: Node, deadline: float
) -> None:
    if deadline < DEADLINE:
        pytest.xfail('one thread: the callback would never return')
    done = Future(executor=executor)

    def call() -> None:
        done.set_result(client.call(SetBool.Request(data=True)))

    node.create_guard_condition(call, callback_group=MutuallyExclusiveCallbackGroup()).trigger()
    executor.spin_until_future_complete(done, deadline)
    assert done.result().success


def test_a_coroutine_awaits_an_answer(client: Client, node: Node, until: Until) -> None:
    answers: list[Any] = []

    async def call() -> None:
        answers.append(await client.call_async(SetBool.Request(data=True)))
        answers.append(await client.call_async(SetBool.Request(data=False)))

    node.create_guard_condition(call).trigger()
    until(lambda: len(answers) == 2)
    assert [each.success for each in answers] == [True, False]


def test_an_exception_of_a_service_is_raised(make_node: Callable[[], Node], until: Until) -> None:
    def fail(*_: object) -> None:
        raise ZeroDivisionError('of the service')

    make_node().create_service(SetBool, 'set', fail)
    client = make_node().create_client(SetBool, 'set')
    until(client.service_is_ready)
    client.call_async(SetBool.Request())
    with pytest.raises(ZeroDivisionError, match='of the service'):
        until(lambda: False)


@pytest.fixture
def owner(context: Context, executor: Executor) -> Iterator[Node]:
    """Return a node with parameters, and services for them."""
    node = Node('owner', context=context, enable_rosout=False)
    node.declare_parameters('', [('gain', 1.5), ('name', 'car'), ('limits.low', 1)])
    executor.add_node(node)
    yield node
    executor.remove_node(node)
    node.destroy_node()


def test_parameters_of_another_node_are_read_and_set(
    owner: Node, node: Node, until: Until, tmp_path: Path
) -> None:
    client = AsyncParameterClient(node, '/owner')
    until(client.services_are_ready)

    def ask(future: Future) -> Any:  # noqa: ANN401
        until(future.done)
        return future.result()

    assert [v.double_value for v in ask(client.get_parameters(['gain'])).values] == [1.5]
    assert ask(client.list_parameters(['limits'], 10)).result.names == ['limits.low']
    assert ask(client.get_parameter_types(['name'])).types[0] == ParameterType.PARAMETER_STRING
    assert ask(client.describe_parameters(['name'])).descriptors[0].name == 'name'

    results = ask(client.set_parameters([Parameter('gain', value=2.5)])).results
    assert [result.successful for result in results] == [True]
    wrong = ask(client.set_parameters_atomically([Parameter('unknown', value=1)])).result
    assert wrong.successful is False
    assert owner.get_parameter('gain').value == 2.5

    file = tmp_path / 'parameters.yaml'
    file.write_text('/owner:\n  ros__parameters:\n    name: bus\n', encoding='utf-8')
    assert ask(client.load_parameter_file(str(file))).results[0].successful
    assert owner.get_parameter('name').value == 'bus'


action = pytest.importorskip('rclpy.action')
Fibonacci = pytest.importorskip('test_msgs.action').Fibonacci


class Actions:
    """A server of an action, and a client."""

    def __init__(self, server: Node, client: Node) -> None:
        self.feedback: list[int] = []
        self.is_released = False
        self.server = action.ActionServer(
            server,
            Fibonacci,
            'fibonacci',
            self._execute,
            goal_callback=self._accept,
            cancel_callback=lambda goal: (
                action.CancelResponse.ACCEPT
                if goal.request.order == -1
                else action.CancelResponse.REJECT
            ),
        )
        self.client = action.ActionClient(client, Fibonacci, 'fibonacci')
        self._server_node = server

    def _accept(self, request: Any) -> Any:  # noqa: ANN401
        response = action.GoalResponse
        return response.REJECT if request.order == 99 else response.ACCEPT

    async def _execute(self, goal: Any) -> Any:  # noqa: ANN401
        for number in range(3):
            goal.publish_feedback(Fibonacci.Feedback(sequence=[number]))
        if goal.request.order == -1:
            end = Future(executor=self._server_node.executor)
            self._server_node.create_timer(
                0.002, lambda: goal.is_cancel_requested and not end.done() and end.set_result(1)
            )
            await end
            goal.canceled()
        elif goal.request.order == -2:
            goal.abort()
        else:
            goal.succeed()
        return Fibonacci.Result(sequence=[goal.request.order])

    def send(self, order: int) -> Future:
        """Send a goal; the future has its handle."""
        return self.client.send_goal_async(
            Fibonacci.Goal(order=order),
            feedback_callback=lambda message: self.feedback.append(message.feedback.sequence[0]),
        )


@pytest.fixture
def actions(make_node: Callable[[], Node], until: Until) -> Iterator[Actions]:
    """Return a server of an action and a client that has found it."""
    actions = Actions(make_node(), make_node())
    until(actions.client.server_is_ready)
    yield actions
    actions.client.destroy()
    actions.server.destroy()


def finished(until: Until, future: Future) -> Any:  # noqa: ANN401
    """Return the result of a future after it is done."""
    until(future.done)
    return future.result()


@pytest.mark.parametrize(
    ('order', 'status'),
    [(3, 'STATUS_SUCCEEDED'), (-2, 'STATUS_ABORTED')],
    ids=['succeeds', 'aborts'],
)
def test_a_goal_has_feedback_and_a_result(
    actions: Actions, until: Until, order: int, status: str
) -> None:
    goal = finished(until, actions.send(order))
    assert goal.accepted
    result = finished(until, goal.get_result_async())
    assert list(result.result.sequence) == [order]
    assert result.status == getattr(action.client.GoalStatus, status)
    until(lambda: len(actions.feedback) == 3)
    assert actions.feedback == [0, 1, 2]


def test_a_rejected_goal_has_no_result(actions: Actions, until: Until) -> None:
    assert finished(until, actions.send(99)).accepted is False
    assert actions.feedback == []


def test_a_goal_is_cancelled(actions: Actions, until: Until) -> None:
    goal = finished(until, actions.send(-1))
    result = goal.get_result_async()
    response = finished(until, goal.cancel_goal_async())
    assert len(response.goals_canceling) == 1
    assert finished(until, result).status == action.client.GoalStatus.STATUS_CANCELED


def test_a_cancel_is_rejected(actions: Actions, until: Until) -> None:
    goal = finished(until, actions.send(3))
    response = finished(until, goal.cancel_goal_async())
    assert len(response.goals_canceling) == 0


def test_goals_run_beside_one_another(actions: Actions, until: Until) -> None:
    goals = [finished(until, sent) for sent in [actions.send(order) for order in (1, 2, 3)]]
    results = [goal.get_result_async() for goal in goals]
    until(lambda: all(result.done() for result in results))
    assert [list(result.result().result.sequence) for result in results] == [[1], [2], [3]]


def test_feedback_after_the_result_was_taken_is_dropped(
    actions: Actions, until: Until, spin_for: Callable[[float], None]
) -> None:
    """The done callback of the result, which forgets the feedback's callback, has run by then."""
    goals = []
    execute = actions.server._execute_callback  # noqa: SLF001 - the test keeps the goal's handle

    async def keep(goal: Any) -> Any:  # noqa: ANN401
        goals.append(goal)
        return await execute(goal)

    actions.server.register_execute_callback(keep)
    goal = finished(until, actions.send(3))
    finished(until, goal.get_result_async())
    until(lambda: len(actions.feedback) == 3)
    message = Fibonacci.Impl.FeedbackMessage(goal_id=goal.goal_id)
    goals[0]._action_server._handle.publish_feedback(message)  # noqa: SLF001 - as a late server
    spin_for(0.05)
    assert actions.feedback == [0, 1, 2]
