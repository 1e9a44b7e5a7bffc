"""Stand-ins for modules that are not here, so that a file with their imports can be loaded."""

from __future__ import annotations

import re
from typing import NoReturn

_ROS_1 = {
    *('rospy', 'roslib', 'barc', 'labs', 'rosbag', 'rosgraph', 'rosnode', 'rostopic'),
    *('dynamic_reconfigure', 'tf', 'tf2_ros', 'cv_bridge'),
}
#: Packages of the lab's messages, which exist in ROS 1 and in ROS 2.
_MESSAGES = re.compile(r'\w+\.(msg|srv)(\..*)?|(std|geometry|sensor|nav)_msgs(\..*)?|std_srvs')
_OPERATORS = (
    *('add', 'radd', 'sub', 'rsub', 'mul', 'rmul', 'truediv', 'rtruediv', 'pow', 'rpow', 'mod'),
    *('rmod', 'floordiv', 'rfloordiv', 'lt', 'le', 'gt', 'ge', 'neg', 'abs', 'float', 'int'),
    *('index', 'iter', 'len', 'getitem', 'setitem'),
)


def is_ros_1(module: str) -> bool:
    """Return whether `module` is one of ROS 1, or of the lab's packages for it.

    Examples
    --------
    >>> is_ros_1('rospy'), is_ros_1('rclpy')
    (True, False)
    """
    return module.partition('.')[0] in _ROS_1


def is_ros(module: str) -> bool:
    """Return whether `module` is one of ROS, which user code does not need.

    Examples
    --------
    >>> is_ros('rclpy'), is_ros('numpy')
    (True, False)
    """
    return is_ros_1(module) or module == 'rclpy' or bool(_MESSAGES.fullmatch(module))


class AbsentModuleError(Exception):
    """User code needs a value of a module that is not here."""


class Absent:
    """Stands for a module that is not here, and for whatever is taken from it.

    It can be called and have attributes; its use as a number is an `AbsentModuleError`.
    """

    def __init__(self, name: str, reason: str) -> None:
        """Stand for `name`, which is missing for `reason`."""
        self._name, self._reason = name, reason

    def __getattr__(self, name: str) -> object:
        """Return what stands for the attribute."""
        if name.startswith('__'):
            raise AttributeError(name)
        if name.endswith(('Exception', 'Error', 'Interrupt')):
            return type(name, (Exception,), {})
        return Absent(f'{self._name}.{name}', self._reason)

    def __call__(self, *_: object, **__: object) -> Absent:
        """Return what stands for the result."""
        return Absent(f'{self._name.removesuffix("()")}()', self._reason)

    def __bool__(self) -> bool:
        """Return True, so that a loop until ROS shuts down ends."""
        return True

    def __repr__(self) -> str:
        """Return the expression that it stands for."""
        return self._name

    def __mro_entries__(self, _: object) -> tuple[type, ...]:
        """Return the base of a class that is derived from it."""
        return (object,)


def _refuse(self: Absent, *_: object, **__: object) -> NoReturn:
    raise AbsentModuleError(f'{self._name}, but {self._reason}')


for _operator in _OPERATORS:
    setattr(Absent, f'__{_operator}__', _refuse)
