"""What findings are drawn of: a user's run beside the reference's."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from barc_sim.simulation.log import Log


@dataclass(frozen=True, eq=False)
class Comparison:
    """The closed loop over one road, with the user's controller and with the reference's."""

    own: Log
    reference: Log


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Two models under the same commands; states in columns x, y [m], psi [rad], v [m/s]."""

    t: NDArray[np.float64]  #: [s], shape `(n,)`
    own: NDArray[np.float64]  #: shape `(n, 4)`, NaN from where the code failed
    reference: NDArray[np.float64]  #: shape `(n, 4)`
