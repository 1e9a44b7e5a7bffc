"""The node `view`: serves the live page, and passes its requests to the other nodes."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from barc_interfaces import msg
from geometry_msgs.msg import Twist
from nav_msgs.msg import Path
from rcl_interfaces.srv import SetParameters
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_srvs.srv import SetBool, Trigger

from barc_sim.cli.parser import MAX_PORT
from barc_sim.errors import UserError
from barc_sim.interfaces import qos, services, topics
from barc_sim.interfaces.nodes import CONTROLLER, SIMULATOR
from barc_sim.interfaces.parameters import ParameterDeclaration
from barc_sim.interfaces.stamps import to_nanoseconds
from barc_sim.page.feed import DEPTH, SUBSCRIBED, Feed
from barc_sim.page.protocol import (
    Pause,
    Press,
    RunFacts,
    Tune,
    node_of,
)
from barc_sim.page.run_page import RunPage
from barc_sim.ros.conversions import to_twist
from barc_sim.ros.parameters import declare

if TYPE_CHECKING:
    from barc_sim.control.driver import DriverInput
    from barc_sim.page.protocol import Request
    from barc_sim.page.run_page import OnDone

MODES = ('acc', 'teleop')
_TYPES = {topic: getattr(msg, topics.MESSAGE_TYPES[topic].split('/')[-1]) for topic in SUBSCRIBED}
_SERVICES = {
    services.RESET_SIMULATOR: Trigger,
    services.RESET_CONTROLLER: Trigger,
    services.PAUSE_SIMULATOR: SetBool,
    **{f'{node}/set_parameters': SetParameters for node in (CONTROLLER, SIMULATOR)},
}


class ViewNode(Node):
    """Serves the live page at `url`, and publishes `cmd_vel` while a page drives.

    Callbacks only store messages; the server's thread does the work, between two steps. `url` has
    the page's token: whoever has this link can drive. `page.end` shows the end of the run.

    Examples
    --------
    >>> import rclpy
    >>> from urllib.request import urlopen
    >>> rclpy.init()
    >>> view = ViewNode('teleop')
    >>> with urlopen(view.url) as answer:
    ...     b'<title>' in answer.read()
    True
    >>> view.destroy_node()
    >>> rclpy.shutdown()
    """

    def __init__(
        self,
        mode: str = 'acc',
        *,
        host: str = '127.0.0.1',
        port: int = 0,
        run: RunFacts = RunFacts(),  # noqa: B008 (immutable)
        **options: Any,  # noqa: ANN401 (Node's own)
    ) -> None:
        """Serve the page; `mode`, `host` and `port` are defaults of the parameters.

        `run` has what no topic carries. Without it the page has no sliders, and draws only the road
        that the car has driven.

        UserError: a parameter is invalid, or the port cannot be used.
        """
        super().__init__('view', **options)

        parameters = [
            ParameterDeclaration('mode', mode, "what the page shows: 'acc' or 'teleop'"),
            ParameterDeclaration('host', host, 'the address to serve the page at'),
            ParameterDeclaration('port', port, 'its port; 0: any free port', (0, MAX_PORT)),
        ]
        values = declare(self, [each._replace(read_only=True) for each in parameters])
        if values['mode'] not in MODES:
            raise UserError(f"mode {values['mode']!r} of the view must be 'acc' or 'teleop'")

        self._feed = Feed()
        self.latest = 0  #: the stamp [ns] of the newest state

        self._cmd_vel_pub = self.create_publisher(Twist, topics.CMD_VEL, qos.DEFAULT)

        for topic, kind in _TYPES.items():
            self.create_subscription(kind, topic, partial(self._on_message, topic), DEPTH)
        self.create_subscription(Path, topics.PREDICTION, self._on_plan, qos.NEWEST)

        self._service_clients = {
            name: self.create_client(kind, name) for name, kind in _SERVICES.items()
        }

        self.page = RunPage(
            values['mode'],
            values['host'],
            values['port'],
            run=run,
            feed=self._feed,
            drive=self._drive,
            request=self._request,
        )
        self.url = self.page.url

    def _on_message(self, topic: str, message: Any) -> None:  # noqa: ANN401 (of the topic's type)
        self._feed.take(topic, message)
        if topic == topics.STATE:
            self.latest = to_nanoseconds(message.header.stamp)

    def _on_plan(self, plan: Path) -> None:
        points = [each.pose.position for each in plan.poses]
        self._feed.plan = [(round(point.x, 3), round(point.y, 3)) for point in points]

    def destroy_node(self) -> None:
        """Close the port, and destroy the node."""
        self.page.close()
        super().destroy_node()

    def _drive(self, request: DriverInput) -> None:
        self._cmd_vel_pub.publish(to_twist(request))

    def _request(self, request: Request, on_done: OnDone) -> None:
        """Pass a request of a page to its service; `on_done` is called in the server's thread."""
        service, message = _call_of(request)
        client = self._service_clients[service]
        if not client.service_is_ready():
            name = self.resolve_service_name(service)
            self.page.call(lambda: on_done(False, f'no node offers {name}'))
            return

        def on_response(future: Any) -> None:  # noqa: ANN401 (a future of rclpy or ros/local)
            has_worked, reason = _result_of(future.result())
            self.page.call(lambda: on_done(has_worked, reason))

        client.call_async(message).add_done_callback(on_response)


def _result_of(response: Any) -> tuple[bool, str]:  # noqa: ANN401 (of any of the services)
    """Return whether a service has done what was requested, and what it answers."""
    if isinstance(response, SetParameters.Response):
        [result] = response.results
        return result.successful, result.reason
    return response.success, response.message


def _call_of(request: Request) -> tuple[str, Any]:
    """Return the name of the service for a page's request, and the message to send."""
    match request:
        case Tune(name, value):
            parameter = Parameter(name, value=value).to_parameter_msg()
            message = SetParameters.Request(parameters=[parameter])
            return f'{node_of(name)}/set_parameters', message
        case Pause(on):
            return services.PAUSE_SIMULATOR, SetBool.Request(data=on)
        case Press('reset'):
            return services.RESET_SIMULATOR, Trigger.Request()
    return services.RESET_CONTROLLER, Trigger.Request()
