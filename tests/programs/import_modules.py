"""Import modules in an interpreter where nothing of ROS can be imported.

    import_modules.py NAME,... MODULE...

Refused are the packages of these names, and packages of messages.
"""

from __future__ import annotations

import importlib
import sys

packages_of_ros = sys.argv[1].split(',')
modules = sys.argv[2:]


class RosRefusingFinder:
    """Raises ImportError for a package of ROS."""

    def find_spec(self, name: str, path: object = None, target: object = None) -> None:  # noqa: ARG002
        """Find nothing."""
        package = name.partition('.')[0]
        if package in packages_of_ros or package.endswith('_msgs'):
            raise ImportError(f'{name} is of ROS')


sys.meta_path.insert(0, RosRefusingFinder())
for module in modules:
    importlib.import_module(module)
