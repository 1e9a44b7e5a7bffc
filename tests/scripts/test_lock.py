"""The locked versions: complete, and as setup.cfg and barc_interfaces allow."""

from __future__ import annotations

import sys
from importlib.machinery import SourceFileLoader
from importlib.metadata import PackageNotFoundError
from importlib.util import module_from_spec, spec_from_loader
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from packaging.markers import default_environment
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[2]
GROUPS = ('run', 'ros', 'test', 'testwheels', 'lint', 'docs', 'sourced')
PYTHONS = ('3.10', '3.11', '3.12', '3.13')

pytestmark = pytest.mark.skipif(sys.version_info < (3, 11), reason='needs tomllib')


@pytest.fixture(scope='module')
def lock() -> Any:  # noqa: ANN401 (a module)
    loader = SourceFileLoader('lock', str(ROOT / 'scripts' / 'lock'))
    module = module_from_spec(spec_from_loader('lock', loader))  # type: ignore[arg-type]
    loader.exec_module(module)
    return module


def text(group: str) -> str:
    return (ROOT / 'requirements' / f'{group}.txt').read_text(encoding='utf-8')


@pytest.mark.parametrize('version', PYTHONS)
def test_each_locked_version_is_within_the_requirements(lock: Any, version: str) -> None:  # noqa: ANN401
    """`scripts/lock` is to be called when a requirement changes."""
    environment = default_environment() | {
        'python_version': version,
        'python_full_version': f'{version}.1',
        'sys_platform': 'linux',
        'extra': '',
    }

    locked: dict[str, Requirement] = {}
    for group in GROUPS[:-1]:
        for line in text(group).splitlines():
            if line[0] not in ' #':
                pin = Requirement(line.removesuffix(' \\'))
                if not pin.marker or pin.marker.evaluate(environment):
                    assert pin.name not in locked
                    locked[pin.name] = pin

        for required in map(Requirement, lock.groups()[group]):
            (pinned,) = locked[canonicalize_name(required.name)].specifier
            assert pinned.version in required.specifier, required


def test_a_sourced_ros_gets_only_the_packages_that_it_lacks(
    lock: Any,  # noqa: ANN401
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    have = {
        'setuptools': ('68.1', []),
        'numpy': ('1.26.4', []),
        'jinja2': ('3.1.2', ['markupsafe>=2.0', 'babel>=2.7; extra == "i18n"']),
        'markupsafe': ('1.0', []),  # older than jinja2 needs
        'rich': ('12.0', []),  # older than setup.cfg needs
    }

    def distribution(name: str) -> SimpleNamespace:
        if name not in have:
            raise PackageNotFoundError(name)
        version, requires = have[name]
        return SimpleNamespace(version=version, requires=requires)

    monkeypatch.setattr(lock, 'distribution', distribution)
    lock.print_lacking(['run'])
    lines = capsys.readouterr().out
    names = {canonicalize_name(name) for name in lock.parse(lines)}
    assert names >= {'markupsafe', 'rich', 'mcap', 'rosbags', 'wheel'}
    assert not names & {'setuptools', 'numpy', 'jinja2', 'mdurl', 'babel'}
    assert all(entry in text('run') for entry in lines.splitlines())

    # What a package of the system cannot have is not installed again and again.
    have['markupsafe'] = (lock.pin(lock.parse(text('run'))['markupsafe'])[2:], [])
    have['jinja2'] = ('3.1.2', ['markupsafe<3'])
    lock.print_lacking(['run'])
    assert 'markupsafe' not in lock.parse(capsys.readouterr().out)

    have['numpy'] = ('1.25', [])
    with pytest.raises(SystemExit, match=r'is needed, but ROS is compiled for NumPy 1\.25'):
        lock.print_lacking(['run'])
