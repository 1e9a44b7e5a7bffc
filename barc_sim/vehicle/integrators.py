"""Steps of ordinary differential equations: forward Euler and the classical Runge-Kutta method.

Both after Hairer, Nørsett and Wanner, "Solving Ordinary Differential Equations I", ch. II.1.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from barc_sim.errors import UserError

Vector = tuple[float, ...]
#: The derivative of a state by time, where nothing but the state changes in a step.
Rates = Callable[[Vector], Vector]


def euler(rates: Rates, state: Vector, ts: float) -> Vector:
    """Return the state `ts` seconds later, by forward Euler: order 1."""
    return _shifted(state, rates(state), ts)


def rk4(rates: Rates, state: Vector, ts: float) -> Vector:
    """Return the state `ts` seconds later, by the classical Runge-Kutta method: order 4."""
    k1 = rates(state)
    k2 = rates(_shifted(state, k1, 0.5 * ts))
    k3 = rates(_shifted(state, k2, 0.5 * ts))
    k4 = rates(_shifted(state, k3, ts))
    return tuple(
        value + ts / 6.0 * (a + 2.0 * b + 2.0 * c + d)
        for value, a, b, c, d in zip(state, k1, k2, k3, k4, strict=True)
    )


def _shifted(state: Vector, rate: Vector, ts: float) -> Vector:
    return tuple(value + ts * slope for value, slope in zip(state, rate, strict=True))


class Integrator(NamedTuple):
    """A method; `order` is that of its error over a given time."""

    step: Callable[[Rates, Vector, float], Vector]
    order: int

    def amplification(self, z: complex) -> float:
        """Return by how much a step of `ts` multiplies a solution of rate `z / ts` [1/s].

        More than 1 where the true one decays is the method's instability.
        """
        term, total = 1.0 + 0.0j, 1.0 + 0.0j
        for k in range(1, self.order + 1):
            term *= z / k
            total += term
        return abs(total)


INTEGRATORS = {'euler': Integrator(euler, 1), 'rk4': Integrator(rk4, 4)}


def integrator(name: str) -> Integrator:
    """Return the integrator called `name`.

    Raises
    ------
    UserError
        where there is none of that name.
    """
    try:
        return INTEGRATORS[name]
    except KeyError:
        raise UserError(f"integrator {name!r} must be 'euler' or 'rk4'") from None
