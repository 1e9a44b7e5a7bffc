"""How Fast DDS is to use memory, unless the user has profiles of their own."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import MutableMapping

_FILE = Path(__file__).with_suffix('.xml')
_NAMES = ('FASTRTPS_DEFAULT_PROFILES_FILE', 'FASTDDS_DEFAULT_PROFILES_FILE')
#: Without it rmw sets how histories use memory itself. What ROS's quality of service says goes
#: before the profiles in either case.
_USE = 'RMW_FASTRTPS_USE_QOS_FROM_XML'


def use_profiles(environment: MutableMapping[str, str] = os.environ) -> None:
    """Have what is started in this `environment` use ours."""
    if not any(name in environment for name in (*_NAMES, _USE)):
        environment[_NAMES[0]] = str(_FILE)
        environment[_USE] = '1'
