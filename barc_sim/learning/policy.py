"""A trained policy as a steering law: it drives `lap`, and the nodes by `barc acc --lane FILE`."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import numpy as np

from barc_sim.errors import UserError
from barc_sim.learning.tasks import AHEAD, TASKS, Seen

if TYPE_CHECKING:
    from collections.abc import Callable

    from barc_sim.control.lane import Curvature

    Policy = Callable[[Any], Any]


class PolicyLane:
    """A policy of `barc_sim/Lane-v0` as a lane controller, to the last bit.

    Examples
    --------
    >>> from barc_sim import lap
    >>> def policy(observation):
    ...     e_y, e_psi, speed, latest, curvature, *ahead = observation
    ...     return [6.0 * curvature - 0.4 * e_y - 1.2 * (e_psi + 1.5 * curvature)]
    >>> log = lap(PolicyLane(policy), 'oval', laps=1)
    >>> print(f'{abs(log.e_y).max():.2f} m off the line')
    0.04 m off the line
    """

    def __init__(self, policy: Policy | str | os.PathLike[str], **options: Any) -> None:  # noqa: ANN401
        """Take a function of the observation that returns the action, or the path of an ONNX file.

        `options` are those of the environment.
        """
        self._task = TASKS['Lane'](**options)
        self._policy = policy if callable(policy) else onnx_policy(policy)
        self.reset()

    def reset(self) -> None:
        """Forget the past: the next call is the first."""
        self._servo = 0.0

    def steer_calculate(
        self, e_y: float, e_psi: float, speed: float, curvature: Curvature
    ) -> float:
        """Return the front angle [rad] for errors in metres and radians, and a speed in m/s."""
        ahead = [curvature(d) for d in AHEAD]
        seen = Seen(self._task.speed - speed, e_y, e_psi, speed, 0.0, self._servo, ahead)
        (share,) = self._policy(self._task.observe(seen))
        _, self._servo = self._task.commands([min(max(float(share), -1.0), 1.0)])
        return self._servo


def onnx_policy(path: str | os.PathLike[str]) -> Policy:
    """Return the policy in an ONNX file: one input of shape (1, numbers), and the action first.

    UserError: onnxruntime is not installed, or the file holds no such policy.
    """
    try:
        import onnxruntime  # noqa: PLC0415 (an extra)
    except ImportError:
        raise UserError(
            f'{os.fspath(path)!r} needs onnxruntime, which is not installed: '
            "pip install 'barc_sim[onnx]'"
        ) from None
    try:
        session = onnxruntime.InferenceSession(os.fspath(path), providers=['CPUExecutionProvider'])
    except Exception as error:  # noqa: BLE001 (of many kinds)
        raise UserError(f'{os.fspath(path)!r} is no ONNX file that can be read: {error}') from None
    (given,) = session.get_inputs()
    kind = np.float64 if 'double' in given.type else np.float32
    return lambda observation: session.run(None, {given.name: observation.astype(kind)[None]})[0][0]
