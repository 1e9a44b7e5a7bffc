"""The kernel's leave to confine submissions."""

from __future__ import annotations

import pytest

from barc_sim.errors import UserError
from barc_sim.lab.confined.process import ProcessLimits, check_confinement


@pytest.fixture(scope='session')
def confinement() -> None:
    """Skip where the kernel confines nothing."""
    try:
        check_confinement(ProcessLimits())
    except UserError as error:
        pytest.skip(str(error))
