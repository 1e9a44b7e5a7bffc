"""Fast DDS's use of memory: ours, unless the user has said something."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from barc_sim.ros.dds_profiles import use_profiles


def test_profiles_are_ours_and_are_used() -> None:
    environment: dict[str, str] = {}
    use_profiles(environment)
    assert environment.pop('RMW_FASTRTPS_USE_QOS_FROM_XML') == '1'
    (path,) = environment.values()
    policies = ET.fromstring(Path(path).read_text(encoding='utf-8')).iter()
    assert [element.text for element in policies if 'MemoryPolicy' in element.tag] == [
        'DYNAMIC',
        'DYNAMIC',
    ]


@pytest.mark.parametrize(
    'name',
    [
        'FASTRTPS_DEFAULT_PROFILES_FILE',
        'FASTDDS_DEFAULT_PROFILES_FILE',
        'RMW_FASTRTPS_USE_QOS_FROM_XML',
    ],
)
def test_what_the_user_has_set_stays(name: str) -> None:
    environment = {name: '0'}
    use_profiles(environment)
    assert environment == {name: '0'}
