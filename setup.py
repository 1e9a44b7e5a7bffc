"""What cannot be declared in setup.cfg; everything else is."""

import sys
from pathlib import Path

from setuptools import Distribution, find_packages, setup

sys.path.insert(0, str(Path(__file__).parent))
from barc_sim.commands import COMMANDS
from barc_sim.interfaces.nodes import ALONE

# An executable for each command and each node, where `ros2 run barc_sim NAME` looks for it.
_EXECUTABLE = """\
#!/bin/sh
# ros2 run barc_sim {name}
here=$(dirname "$0")
barc=$here/barc                              # colcon's place
[ -x "$barc" ] || barc=$here/../../bin/barc  # pip's place
exec "$barc" {words} "$@"
"""


def executables() -> list[str]:
    """Write the executables, and return their paths."""
    words = {name: name for name in COMMANDS if name != 'node'}
    words |= {name: f'node {name}' for name in ALONE}
    folder = Path('build', 'ros2_run')
    folder.mkdir(parents=True, exist_ok=True)
    for name in words:
        (folder / name).write_text(_EXECUTABLE.format(name=name, words=words[name]))
        (folder / name).chmod(0o755)
    return [str(folder / name) for name in words]


class WithData(Distribution):
    """Installs `data_files` also in editable mode, which asks for `has_data` by mistake."""

    has_data = Distribution.has_data_files


setup(
    distclass=WithData,
    # The definitions of the lab's messages, for runs without ROS.
    packages=[
        *find_packages(include=['barc_sim', 'barc_sim.*']),
        'barc_sim.interfaces.msg.barc_interfaces',
    ],
    package_dir={'barc_sim.interfaces.msg.barc_interfaces': 'barc_interfaces/msg'},
    # colcon cannot read what setup.cfg would make of it.
    python_requires='>=3.10,<3.14',
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/barc_sim']),
        ('share/barc_sim', ['package.xml']),
        ('lib/barc_sim', executables()),
    ],
)
