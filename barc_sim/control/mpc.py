"""Model predictive control of the lane, and of lane and speed.

The quadratic program is in `planning`, which needs NumPy: `--help` lists the gains without it.
"""

from __future__ import annotations

from time import thread_time
from typing import TYPE_CHECKING

from barc_sim.control.lane import STEERING_LIMIT, LaneLaw, steady_turn
from barc_sim.control.speed import Gain
from barc_sim.vehicle.parameters import SERVO
from barc_sim.vehicle.plant import Actuator, actuator_response

if TYPE_CHECKING:
    from collections.abc import Mapping

    from barc_sim.control.lane import Curvature

_SLOWEST = 0.1  #: [m/s] A slower car counts as one of this speed.
_LAG = 0.05  #: [m] λ is rounded to multiples, so that few programs have to be made
_LOOKS = 80  #: of the curvature on the way to a stop


class MPC(LaneLaw):
    """Steers with the optimal plan of the next 20 steps, with limits of the angle and its rate.

    The equations are in `barc_sim.control.planning`.

    Examples
    --------
    >>> from barc_sim import MPC, lap
    >>> print(f'{abs(lap(MPC(), "oval", laps=1).e_y).max():.2f} m off the line')
    0.03 m off the line
    """

    gains: Mapping[str, Gain] = {
        'q_e_y': Gain(0.2, 'rad²/m²', 'weight of the lateral error', 1.0, (1e-6, 1e3)),
        'q_e_psi': Gain(0.2, '-', 'weight of the heading error', 10.0, (0.0, 1e3)),
        'q_change': Gain(1.0, 'm', 'weight of the change from step to step', 10.0, (0.0, 1e3)),
        'step': Gain(0.5, 'm', 'length of each of the 20 steps', 2.0, (1e-3, 100.0)),
        'delay': Gain(0.0, 's', 'delay of the steering', 1.0, (0.0, 10.0)),
        'lag': Gain(SERVO.lag, 's', 'time constant of the steering', 1.0, (0.0, 10.0)),
        'rate': Gain(SERVO.rate, 'rad/s', 'maximum rate of the steering', 5.0, (1e-3, 1e3)),
        'period': Gain(0.02, 's', 'time from one call to the next', 0.1, (1e-3, 1.0)),
    }
    terms: Mapping[str, str] = {
        'feedforward': 'steering angle for the track where the command acts',
        'solve_time': '[s] processor time of the whole computation',
        'infeasible': '1 if no command is within all limits',
    }
    q_e_y: float
    q_e_psi: float
    q_change: float
    step: float
    delay: float
    lag: float
    rate: float
    period: float

    def reset(self) -> None:
        """Forget the past: the next call is the first."""
        import numpy as np  # noqa: PLC0415 (slow: not for --help)

        from barc_sim.control.planning import HORIZON, solver  # noqa: PLC0415 (as above)

        solver()  # or a UserError
        self.feedforward = 0.0
        self.solve_time = 0.0
        self.infeasible = 0.0
        self._servo = 0.0  # [rad] the present angle
        self._latest = 0.0  # [rad] the command before
        self._sent: list[float] = []  # the commands on their way
        #: The latest plan, shape `(21, 2)`: distance ahead and e_y [m].
        self.prediction = np.zeros((HORIZON + 1, 2))

    def steer_calculate(
        self, e_y: float, e_psi: float, speed: float, curvature: Curvature
    ) -> float:
        """Return the front angle [rad] for errors in metres and radians, and a speed in m/s."""
        began = thread_time()
        v = max(abs(speed), _SLOWEST)
        actuator = Actuator(lag=self.lag, rate=self.rate)
        start, state = self._where_it_acts(actuator, e_y, e_psi, v, curvature)
        command = self._plan(start, state, v, curvature)
        self._latest = min(max(command, -STEERING_LIMIT), STEERING_LIMIT)

        self._sent.append(self._latest)
        self._servo, _ = actuator_response(actuator, self._servo, self._sent.pop(0), self.period)
        self.solve_time = thread_time() - began
        return self._latest

    def _plan(
        self, start: float, state: tuple[float, float, float], v: float, curvature: Curvature
    ) -> float:
        """Plan from `start` [m] ahead on, where `state` is e_y, e_psi and δ; return u [rad]."""
        import numpy as np  # noqa: PLC0415 (as above)

        from barc_sim.control.planning import CHANGE, HORIZON, program, solver  # noqa: PLC0415

        n = HORIZON
        step = self.step
        before = self._latest

        # The costs, from the state and the steady turns of the track ahead.
        weights = self.q_e_y, self.q_e_psi, self.q_change
        distance = _LAG * round(v * self.lag / _LAG)
        hessian, by_ahead, across = program(distance, step, weights, self.l_f, self.l_r)
        bends = [curvature(start + (k + 0.5) * step) for k in range(n)]
        turns = [steady_turn(bend, self.l_f, self.l_r) for bend in bends]
        steer, heading = zip(*turns, strict=True)
        ahead = np.array([*state, *steer, *heading])
        gradient = by_ahead @ ahead
        gradient[0] -= self.q_change * before

        # The limits of the angle, and of its changes from the command before.
        upper = np.repeat([STEERING_LIMIT, self.rate * step / v], n)
        upper[n] = self.rate * self.period
        lower = -upper
        upper[n] += before
        lower[n] += before

        commands, _, flag, _ = solver()(hessian, gradient, CHANGE, upper, lower)
        self.feedforward = steer[0]
        self.infeasible = float(flag < 1)
        if self.infeasible:
            commands = np.full(n, before)
        e_y = across @ np.concatenate([commands, ahead])
        self.prediction = np.column_stack([start + step * np.arange(n + 1), [state[0], *e_y]])
        return float(commands[0])

    def _where_it_acts(
        self, actuator: Actuator, e_y: float, e_psi: float, v: float, curvature: Curvature
    ) -> tuple[float, tuple[float, float, float]]:
        """Return the distance [m] until the next command acts; and e_y, e_psi and δ there."""
        steps = round(self.delay / self.period)  # which may have changed
        self._sent = ([self._servo] * steps + self._sent)[len(self._sent) :]

        length = self.l_f + self.l_r
        step = v * self.period
        angle = self._servo
        ahead = 0.0
        for command in self._sent:
            angle, mean = actuator_response(actuator, angle, command, self.period)
            steer, heading = steady_turn(curvature(ahead + 0.5 * step), self.l_f, self.l_r)
            turn = (mean - steer) * step / length
            e_y += (e_psi + 0.5 * turn - heading) * step + self.l_r * turn
            e_psi += turn
            ahead += step
        return ahead, (e_y, e_psi, angle)


class SpeedMPC(MPC):
    """Plans the speed, too: as fast as the limits of the accelerations and `top_speed` allow.

    Over the distance, the square of the speed is linear in the acceleration. So the fastest plan
    over the stopping distance needs no search: the car brakes as late as possible::

        (v²)' = 2 a        v² |κ| ≤ lateral        |a| ≤ longitudinal        v ≤ top_speed

    `acceleration` [m/s²] is the first one of the plan; it replaces the speed controller's.

    Examples
    --------
    >>> from barc_sim import SpeedMPC, lap
    >>> print(f'{lap(SpeedMPC(lateral=3.2), "oval", laps=2).best:.2f} s')
    25.38 s
    """

    gains: Mapping[str, Gain] = {
        **MPC.gains,
        'top_speed': Gain(12.0, 'm/s', 'maximum speed', 30.0, (0.1, 100.0)),
        'lateral': Gain(3.5, 'm/s²', 'maximum lateral acceleration', 10.0, (0.1, 100.0)),
        'longitudinal': Gain(2.0, 'm/s²', 'maximum longitudinal acceleration', 10.0, (0.1, 100.0)),
    }
    top_speed: float
    lateral: float
    longitudinal: float
    acceleration: float = 0.0

    def steer_calculate(
        self, e_y: float, e_psi: float, speed: float, curvature: Curvature
    ) -> float:
        """Return the front angle [rad], and set `acceleration` [m/s²]."""
        began = thread_time()
        gain = 2.0 * self.longitudinal
        look = max(self.top_speed**2 / (gain * _LOOKS), 0.25)
        bends = [abs(curvature(k * look)) for k in range(_LOOKS + 3)]
        # A turn begins and ends between two points, and counts for both. It also counts one point
        # early: the car brakes for the next point, and so approaches its speed exponentially.
        bends = [*map(max, bends, bends[1:], bends[2:], bends[3:])]

        # Squares of speeds [m²/s²].
        limits = (self.lateral / max(bend, self.lateral / self.top_speed**2) for bend in bends)
        allowed = min(limit + gain * look * k for k, limit in enumerate(limits))
        limit = self.longitudinal
        self.acceleration = max(-limit, min((allowed - speed * abs(speed)) / (2.0 * look), limit))

        steer = super().steer_calculate(e_y, e_psi, speed, curvature)
        self.solve_time = thread_time() - began
        return steer
