"""The node `controller`: holds the speed; each state that arrives is answered by a command."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar

from barc_interfaces.msg import EZDynBkMdl, ZDynBkMdl
from rclpy.node import Node
from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from barc_sim.bags.cdr import leading_time
from barc_sim.control.cruise_control import SPEEDS, TYPE, CruiseControl
from barc_sim.control.pid import ACCELERATION_LIMIT
from barc_sim.control.types import DEFAULT_TYPE
from barc_sim.ros import names
from barc_sim.ros.endpoints import drained_subscription, subscription
from barc_sim.ros.executor import QuickCallbackGroup
from barc_sim.ros.fields import FieldPublisher, field_reader
from barc_sim.ros.parameters import declare
from barc_sim.ros.warnings import RateLimitedWarning, RefusedInput
from barc_sim.simulation.publishers import AnswerPublishers

if TYPE_CHECKING:
    from rclpy.parameter import Parameter as RosParameter

    from barc_sim.control.controller import Controller


class CruiseController(Node):
    """Answers each `z_vhcl` with an `ecu` of the same stamp; its dt is the difference of stamps.

    Gains, reference and limit may be changed while it runs; the reference on the topic
    `speed_reference`, too, by an outer loop: what came last, there or as parameter, holds.

    Attributes
    ----------
    values
        The parameters, by name.
    inputs
        The topics that it subscribes to, with their types.

    Examples
    --------
    >>> import rclpy
    >>> rclpy.init()
    >>> node = CruiseController()
    >>> node.set_parameters([rclpy.Parameter('speed_reference', value=10.0)])[0].successful
    True
    >>> node.values['speed_reference']
    10.0
    >>> node.destroy_node()
    >>> rclpy.shutdown()
    """

    inputs: ClassVar[dict[str, type[Any]]] = {
        names.STATE: ZDynBkMdl,
        names.STATE_ERROR: EZDynBkMdl,
        names.SPEED_REFERENCE: Float64,
    }

    def __init__(
        self,
        *,
        controller: Controller | None = None,
        acceleration_limit: float = ACCELERATION_LIMIT,
        **options: Any,  # noqa: ANN401 (Node's own)
    ) -> None:
        """Declare the parameters and wait for states.

        `controller` takes the place of the one that the parameter `controller_type` names; any
        object with the lab's `acc_calculate` works. `acceleration_limit` is the default of that
        parameter.

        Raises
        ------
        UserError
            where a parameter is out of range, or `controller` cannot work with them.
        """
        super().__init__('controller', **options)
        self._refusals = RefusedInput(self)
        self._gone_back = RateLimitedWarning(self)
        kind = DEFAULT_TYPE if controller is not None else declare(self, [TYPE])[TYPE.name]
        self._control = CruiseControl(controller, kind, self._refusals.add, self._gone_back.warn)
        self.values = self._control.values
        self._control.configure(declare(self, self._control.parameters(acceleration_limit)))
        self._control.reset()
        self.add_post_set_parameters_callback(self._on_parameters)
        self._state: bytes | None = None
        self._error: bytes | None = None
        self._read_speed = field_reader(ZDynBkMdl, 'v_x')
        self._read_speed_error = field_reader(EZDynBkMdl, 'v_x')

        self._answers = AnswerPublishers(partial(FieldPublisher, self), self._control.controller)
        group = QuickCallbackGroup()
        for kind, topic, callback in (
            (EZDynBkMdl, names.STATE_ERROR, self._on_state_error),
            (ZDynBkMdl, names.STATE, self._on_state),
        ):
            drained_subscription(self, kind, topic, callback, group)
        subscription(
            self,
            Float64,
            names.SPEED_REFERENCE,
            self._on_speed_reference,
            group,
            qos=names.QOS_NEWEST,
        )
        self.create_service(Trigger, names.RESET_CONTROLLER, self._on_reset, callback_group=group)

    def _on_speed_reference(self, message: Float64) -> None:
        low, high = SPEEDS
        if low <= message.data <= high:
            self.values['speed_reference'] = message.data
            return
        self._refusals.add(
            lambda: (
                f'a speed_reference of {message.data}: it must lie between {low:g} and {high:g} m/s'
            )
        )

    @property
    def refused(self) -> int:
        """References and states that were out of range."""
        return self._refusals.count

    def _on_parameters(self, parameters: list[RosParameter]) -> None:
        self._control.configure({parameter.name: parameter.value for parameter in parameters})

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._control.reset()
        self._state = self._error = None
        response.success, response.message = True, 'as at the start'
        self.get_logger().debug('reset')
        return response

    def _on_state(self, state: bytes) -> None:
        if self.values['subtract_error']:
            self._state = state
            self._join()
        else:
            self._answer(leading_time(state), self._read_speed(state))

    def _on_state_error(self, error: bytes) -> None:
        if self.values['subtract_error']:
            self._error = error
            self._join()

    def _join(self) -> None:
        """Answer once the state and the error of the same stamp are both there."""
        state, error = self._state, self._error
        if state and error and (stamp := leading_time(state)) == leading_time(error):
            self._answer(stamp, self._read_speed(state) - self._read_speed_error(error))

    def _answer(self, stamp: int, speed: float) -> None:
        answer = self._control.answer(stamp, speed)
        if answer is not None:
            self._answers.publish(stamp, answer)
