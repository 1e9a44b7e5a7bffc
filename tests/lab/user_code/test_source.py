"""A user's file before it runs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from barc_sim.lab.user_code.source import UserCodeError, compiled, read

ROS_1 = """#!/usr/bin/env python
import rospy
from barc.msg import ECU, Z_DynBkMdl
from math import sin

rospy.init_node('x')

class PID:
    pass

def main():
    rospy.spin()

if __name__ == '__main__':
    try:
        main()
    except rospy.ROSInterruptException:
        pass
"""

if TYPE_CHECKING:
    from pathlib import Path

    from barc_sim.lab.user_code.source import Source


def source(tmp_path: Path, data: bytes) -> Source:
    path = tmp_path / 'controller.py'
    path.write_bytes(data)
    return read(path, 'controller.py')


def test_the_labs_template_for_ros_1_names_the_lines_to_delete(tmp_path: Path) -> None:
    with pytest.raises(UserCodeError) as caught:
        compiled(source(tmp_path, ROS_1.encode()))
    assert str(caught.value) == (
        'controller.py, line 2: import rospy: ROS 1 is not installed and not needed: '
        'delete the lines 2, 3, 6; barc_sim provides the nodes'
    )


def test_what_is_left_of_the_template_is_compiled(tmp_path: Path) -> None:
    lines = ROS_1.splitlines()
    kept = [line for number, line in enumerate(lines, 1) if number not in {2, 3, 6}]
    module = {'__name__': 'controller'}
    exec(compiled(source(tmp_path, '\n'.join(kept).encode())), module)  # noqa: S102
    assert 'PID' in module


def test_print_without_brackets_is_named(tmp_path: Path) -> None:
    with pytest.raises(UserCodeError, match=r"line 1: .*Missing parentheses.*: print 'hi'$"):
        compiled(source(tmp_path, b"print 'hi'\n"))


def test_tabs_and_blanks_mixed_are_named(tmp_path: Path) -> None:
    with pytest.raises(UserCodeError, match=r'controller\.py, line 3: .*tabs'):
        compiled(source(tmp_path, b'if 1:\n        x = 1\n\tx = 2\n'))


@pytest.mark.parametrize('data', [b'\xff\xfex\0', 'x = 1\n# °'.encode('latin-1')])
def test_another_encoding_is_refused(tmp_path: Path, data: bytes) -> None:
    with pytest.raises(UserCodeError, match=r'line [12]: the byte 0x(ff|b0) is not UTF-8: save'):
        source(tmp_path, data)


def test_the_mark_that_windows_puts_in_front_is_no_harm(tmp_path: Path) -> None:
    module: dict[str, object] = {}
    exec(compiled(source(tmp_path, b'\xef\xbb\xbfx = 1\r\n')), module)  # noqa: S102
    assert module['x'] == 1


def test_a_string_that_warns_does_not_fail(tmp_path: Path) -> None:
    compiled(source(tmp_path, b"x = '\\d'\n"))


def test_a_file_of_no_sensible_size_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UserCodeError, match='more than 1000000 bytes'):
        source(tmp_path, b'#' * 1_000_001)


def test_a_folder_in_place_of_a_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UserCodeError, match='Is a directory'):
        read(tmp_path, 'controller.py')


def test_brackets_without_end_are_refused(tmp_path: Path) -> None:
    with pytest.raises(UserCodeError, match=r'no Python 3'):
        compiled(source(tmp_path, b'(' * 100_000))
