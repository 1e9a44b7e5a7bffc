"""Model predictive control of the lane, and of lane and speed, by a quadratic program a step.

The errors are predicted over the distance along the centre line, not over time: then their model is
the same at every speed, and so are the weights. With κ of the centre line, the actual angle δ, its
steady turn δ(κ), e_psi(κ), and λ = v · lag, for a distance s::

    e_y' = e_psi - e_psi(κ) + (l_r / L)(δ - δ(κ))    e_psi' = (δ - δ(κ)) / L    δ' = (u - δ) / λ

The commands on their way bring the measured errors to where the next command acts (a Smith
predictor). From there on, in steps of `step` metres over which u is held, the program minimises::

    Σ step (q_e_y e_y² + q_e_psi (e_psi - e_psi(κ))² + (u - δ(κ))²) + q_change Σ (u - u before)²

with the limits of the angle and of its rate. Behind the last step is the cost of the LQR, from the
algebraic Riccati equation: the first command is that LQR's where no limit, no lag and no weight of
the change matter (Rawlings, Mayne, Diehl, "Model Predictive Control", 2.5).
"""

from __future__ import annotations

from collections import deque
from math import exp, nan
from time import thread_time
from typing import TYPE_CHECKING, Any

from barc_sim.control.lane import LaneLaw, steady_turn
from barc_sim.control.speed import Gain
from barc_sim.vehicle.parameters import SERVO
from barc_sim.vehicle.plant import Actuator

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy as np
    from numpy.typing import NDArray

    from barc_sim.control.lane import Curvature

    Floats = NDArray[np.float64]

HORIZON = 20  #: steps
_SLOWEST = 0.1  #: [m/s] A slower car counts as one of this speed.
_LOOKS = 4  #: of the curvature in a step of the speed
_SOFT = 8  #: daqp's code of a limit that may be broken where there is no other way


class MPC(LaneLaw):
    """Steers by the best plan of the next 20 steps, with limits of the angle and of its rate.

    The equations are in the module's docstring. `prediction` is the plan, shape `(21, 2)`:
    distance ahead and e_y [m].

    Examples
    --------
    >>> from barc_sim import MPC, lap
    >>> print(f'{abs(lap(MPC(), "oval", laps=1).e_y).max():.2f} m off the line')
    0.03 m off the line
    """

    gains: Mapping[str, Gain] = {
        'q_e_y': Gain(0.2, 'rad²/m²', 'weight of the error across', 1.0, (1e-6, 1e3)),
        'q_e_psi': Gain(0.2, '-', 'weight of the error of the heading', 10.0, (0.0, 1e3)),
        'q_change': Gain(1.0, 'm', 'weight of the change from step to step', 10.0, (0.0, 1e3)),
        'step': Gain(0.5, 'm', 'length of each of the 20 steps', 2.0, (1e-3, 100.0)),
        'delay': Gain(0.0, 's', 'delay of the steering', 1.0, (0.0, 10.0)),
        'lag': Gain(SERVO.lag, 's', 'time constant of the steering', 1.0, (0.0, 10.0)),
        'rate': Gain(SERVO.rate, 'rad/s', 'maximum rate of the steering', 5.0, (1e-3, 1e3)),
        'period': Gain(0.02, 's', 'time from one call to the next', 0.1, (1e-3, 1.0)),
    }
    terms: Mapping[str, str] = {
        'feedforward': 'steering of the track where the command acts',
        'solve_time': '[s] of the processor for the whole computation',
        'infeasible': '1 where no command is within all limits',
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
        import numpy as np  # noqa: PLC0415 (slow: `--help` lists the gains)

        from barc_sim.vehicle.racing_line import solver  # noqa: PLC0415 (as above)

        super().reset()
        self._solve = solver().solve
        self._change = np.eye(HORIZON) - np.eye(HORIZON, k=-1)
        self.of_e_y = self.of_e_psi = nan  # one sum of the plan
        self.solve_time = self.infeasible = 0.0
        self.prediction = np.zeros((HORIZON + 1, 2))
        self._servo = self._latest = 0.0  # [rad] the angle, and the command before
        self._sent: deque[float] = deque()  # the commands on their way
        self._terminal: tuple[Any, Floats] = (None, np.zeros((2, 2)))

    def steer_calculate(
        self, e_y: float, e_psi: float, speed: float, curvature: Curvature
    ) -> float:
        """Return the front angle [rad] for errors in metres and radians, and a speed in m/s."""
        began = thread_time()
        v = max(abs(speed), _SLOWEST)
        start, state = self._where_it_acts(e_y, e_psi, v, curvature)
        speeds = self._speeds(v, start, curvature)
        command = self._plan(state, start, speeds, curvature)
        self._latest = min(max(command, -self.output_max), self.output_max)
        self.saturated = abs(self._latest) >= self.output_max * (1.0 - 1e-9)
        self._sent.append(self._latest)
        actuator = Actuator(lag=self.lag, rate=self.rate)
        self._servo, _ = actuator.respond(self._servo, self._sent.popleft(), self.period)
        self.solve_time = thread_time() - began
        return self._latest

    def _speeds(self, v: float, start: float, curvature: Curvature) -> Floats:  # noqa: ARG002
        """Return the speed [m/s] in each step of the plan, `start` metres ahead."""
        import numpy as np  # noqa: PLC0415 (slow: `--help` lists the gains)

        return np.full(HORIZON, v)

    def _where_it_acts(
        self, e_y: float, e_psi: float, v: float, curvature: Curvature
    ) -> tuple[float, Floats]:
        """Return the distance [m] until the next command acts; and e_y, e_psi and δ there."""
        import numpy as np  # noqa: PLC0415 (slow: `--help` lists the gains)

        waiting = round(self.delay / self.period)
        while len(self._sent) < waiting:
            self._sent.appendleft(self._servo)
        while len(self._sent) > waiting:
            self._sent.popleft()
        actuator, length = Actuator(lag=self.lag, rate=self.rate), self.l_f + self.l_r
        angle, ahead, step = self._servo, 0.0, v * self.period
        for command in self._sent:
            angle, mean = actuator.respond(angle, command, self.period)
            steer, heading = steady_turn(curvature(ahead + 0.5 * step), self.l_f, self.l_r)
            turn = (mean - steer) * step / length
            e_y += (e_psi + 0.5 * turn - heading) * step + self.l_r * turn
            e_psi, ahead = e_psi + turn, ahead + step
        return ahead, np.array([e_y, e_psi, angle])

    def _plan(self, state: Floats, start: float, speeds: Floats, curvature: Curvature) -> float:
        """Return the first command [rad] of the best plan from `state` on."""
        import numpy as np  # noqa: PLC0415 (slow: `--help` lists the gains)

        n, step = HORIZON, self.step
        bends = [curvature(start + (k + 0.5) * step) for k in range(n)]
        steer, heading = np.array([steady_turn(bend, self.l_f, self.l_r) for bend in bends]).T
        self.feedforward = float(steer[0])
        # The states as linear functions of the commands; the last column is without any.
        now = np.zeros((3, n + 1))
        now[:, n] = state
        across, turned = np.empty((n, n + 1)), np.empty((n, n + 1))
        models = {v: self._model(v) for v in {*speeds.tolist()}}
        for k, v in enumerate(speeds.tolist()):
            matrix, by_command, by_track = models[v]
            now = matrix @ now
            now[:, k] += by_command
            now[:, n] -= by_track * steer[k]
            now[0, n] -= step * heading[k]
            across[k], turned[k] = now[0], now[1]
        turned[:-1, n] -= heading[1:]
        turned[-1, n] -= heading[-1]
        root = np.vstack([across[-1], turned[-1]])
        terminal = self._cost_to_go()
        y, e = across[:-1], turned[:-1]
        by_all = step * (self.q_e_y * y.T @ y + self.q_e_psi * e.T @ e) + root.T @ terminal @ root
        hessian = by_all[:n, :n] + step * np.eye(n) + self.q_change * self._change.T @ self._change
        gradient = by_all[:n, n] - step * steer
        gradient[0] -= self.q_change * self._latest
        limit = np.full(n, self.output_max)
        change = self.rate * step / speeds
        change[0] = self.rate * self.period
        first = np.zeros(n)
        first[0] = self._latest
        upper, lower = (
            np.concatenate([sign * limit, first + sign * change]) for sign in (1.0, -1.0)
        )
        commands, _, flag, _ = self._solve(hessian, gradient, self._change, upper, lower)
        self.infeasible = float(flag < 1)
        if self.infeasible:
            commands = np.full(n, self._latest)
        self.prediction[0] = start, state[0]
        self.prediction[1:, 0] = start + step * np.arange(1, n + 1)
        self.prediction[1:, 1] = across[:, :n] @ commands + across[:, n]
        return float(commands[0])

    def _model(self, v: float) -> tuple[Floats, Floats, Floats]:
        """Return what a step makes of the state, of its command, and of the steady turn."""
        import numpy as np  # noqa: PLC0415 (slow: `--help` lists the gains)

        length, step, distance = self.l_f + self.l_r, self.step, v * self.lag
        left = exp(-step / distance) if distance > 0.0 else 0.0
        once = distance * (1.0 - left)  # integral of what is left of the angle
        twice = distance * (step - once)
        half = 0.5 * step * step
        matrix = np.array(
            [
                [1.0, step, (self.l_r * once + twice) / length],
                [0.0, 1.0, once / length],
                [0.0, 0.0, left],
            ]
        )
        by_track = np.array([(self.l_r * step + half) / length, step / length, 0.0])
        by_command = by_track - matrix[:, 2]
        by_command[2] = 1.0 - left
        return matrix, by_command, by_track

    def _cost_to_go(self) -> Floats:
        """Return the matrix of the cost of e_y and e_psi behind the last step, without lag."""
        import numpy as np  # noqa: PLC0415 (slow: `--help` lists the gains)

        key = self.q_e_y, self.q_e_psi, self.step
        if self._terminal[0] != key:
            length = self.l_f + self.l_r
            a = np.array([[1.0, self.step], [0.0, 1.0]])
            b = self.step / length * np.array([[self.l_r + 0.5 * self.step], [1.0]])
            weights = self.step * np.diag([self.q_e_y, self.q_e_psi])
            self._terminal = key, riccati(a, b, weights, self.step)
        return self._terminal[1]


def riccati(a: Floats, b: Floats, weights: Floats, weight: float) -> Floats:
    """Return the solution of the discrete algebraic Riccati equation of one input, by doubling.

    Chu, Fan, Lin, Wang, "Structure-preserving algorithms for periodic discrete-time algebraic
    Riccati equations", Int. J. Control 77, 2004.
    """
    import numpy as np  # noqa: PLC0415 (slow: `--help` lists the gains)

    g, h, one = b @ b.T / weight, weights, np.eye(len(a))
    for _ in range(60):
        inverse = np.linalg.inv(one + g @ h)
        a, g, h, before = (
            a @ inverse @ a,
            g + a @ inverse @ g @ a.T,
            h + a.T @ h @ inverse @ a,
            h,
        )
        if np.allclose(h, before, rtol=1e-14, atol=0.0):
            break
    return h


class SpeedMPC(MPC):
    """Plans the speed, too: as fast as limits of the accelerations allow, `top_speed` at most.

    Over the distance, the square of the speed is linear in the acceleration::

        (v²)' = 2 a        v² |κ| ≤ lateral        |a| ≤ longitudinal        v ≤ top_speed

    The plan reaches as far as the way to a stop. `acceleration` [m/s²] is its first, which drives
    in place of the speed controller; the speeds of the plan are those of the lane's model.

    Examples
    --------
    >>> from barc_sim import SpeedMPC, lap
    >>> print(f'{lap(SpeedMPC(lateral=3.2), "oval", laps=2).best:.2f} s')
    25.39 s
    """

    gains: Mapping[str, Gain] = {
        **MPC.gains,
        'top_speed': Gain(12.0, 'm/s', 'maximum speed', 30.0, (0.1, 100.0)),
        'lateral': Gain(3.5, 'm/s²', 'maximum acceleration across', 10.0, (0.1, 100.0)),
        'longitudinal': Gain(2.0, 'm/s²', 'maximum acceleration along', 10.0, (0.1, 100.0)),
    }
    top_speed: float
    lateral: float
    longitudinal: float

    def reset(self) -> None:
        """Forget the past: the next call is the first."""
        import numpy as np  # noqa: PLC0415 (slow: `--help` lists the gains)

        super().reset()
        self.acceleration = 0.0
        self._sum = np.tril(np.ones((HORIZON, HORIZON)))
        self._soft = np.repeat(np.array([0, _SOFT], np.intc), HORIZON)

    def _speeds(self, v: float, start: float, curvature: Curvature) -> Floats:
        import numpy as np  # noqa: PLC0415 (slow: `--help` lists the gains)

        n, top = HORIZON, self.top_speed**2
        step = max(1.0, top / (2.0 * self.longitudinal * n))
        look = step / _LOOKS
        bends = np.abs([curvature(k * look) for k in range((n + 1) * _LOOKS + 1)])
        bends = np.maximum(bends[:-1], bends[1:])
        limits = (self.lateral / np.maximum(bends, self.lateral / top)).reshape(n + 1, -1)
        near, allowed = limits[0], limits.min(1)
        allowed = np.minimum(allowed[:-1], allowed[1:])
        # Within the first step, the way to an arc counts, not to the step's end.
        ways = step / (look * np.maximum(np.arange(_LOOKS), 1.0))
        allowed[0] = min(allowed[0], v * v + float(((near - v * v) * ways).min()))
        # In shares: of `longitudinal`, and of the square of the top speed.
        gain = 2.0 * step * self.longitudinal / top
        reach, missing = gain * self._sum, v * v / top - allowed / top
        hessian = reach.T @ reach + 1e-3 * np.eye(n)
        shares, *_ = self._solve(
            hessian,
            reach.T @ missing,
            self._sum,
            np.concatenate([np.ones(n), -missing / gain]),
            np.concatenate([-np.ones(n), np.full(n, -np.inf)]),
            self._soft,
        )
        self.acceleration = self.longitudinal * float(shares[0])
        squares = np.maximum(v * v + top * reach @ shares, _SLOWEST**2)
        places = start + self.step * (np.arange(n) + 0.5)
        found: Floats = np.sqrt(np.interp(places, step * np.arange(n + 1), [v * v, *squares]))
        return found
