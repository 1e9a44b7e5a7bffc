"""A CMake project can use the messages as pip has built them."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip('rclpy')
PREFIX = Path(sys.prefix)
EXPORTS = PREFIX / 'share' / 'barc_interfaces' / 'cmake'
pytestmark = pytest.mark.skipif(not EXPORTS.is_dir(), reason='pip has not built the messages')
#: Uses a target as ROS's wheels export theirs.
PROJECT = f"""
cmake_minimum_required(VERSION 3.22)
project(uses_the_messages CXX)
add_library(exported INTERFACE IMPORTED)
set_target_properties(exported PROPERTIES
  INTERFACE_INCLUDE_DIRECTORIES "/opt/python/nowhere;${{CMAKE_SOURCE_DIR}}/here")
include("{EXPORTS / 'existing_includes.cmake'}")
add_library(uses SHARED uses.cpp)
target_link_libraries(uses exported)
"""


def test_exported_targets_name_no_path_of_the_build_environment() -> None:
    text = ''.join(file.read_text() for file in EXPORTS.glob('*Export.cmake'))
    assert 'pip-build-env' not in text
    assert 'numpy' not in text


@pytest.mark.slow
@pytest.mark.skipif(not shutil.which('cmake'), reason='CMake is not installed')
def test_a_project_can_link_to_targets_that_name_folders_of_another_machine(tmp_path: Path) -> None:
    (tmp_path / 'here').mkdir()
    (tmp_path / 'here' / 'answer.hpp').write_text('inline int answer() { return 42; }\n')
    (tmp_path / 'uses.cpp').write_text('#include "answer.hpp"\nint uses() { return answer(); }\n')
    (tmp_path / 'CMakeLists.txt').write_text(PROJECT)
    for words in (['-S', '.', '-B', 'build'], ['--build', 'build']):
        process = subprocess.run(
            [shutil.which('cmake'), *words],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=False,
        )
        assert process.returncode == 0, process.stdout + process.stderr

    assert 'existing_includes.cmake' in (EXPORTS / 'barc_interfacesConfig.cmake').read_text()
