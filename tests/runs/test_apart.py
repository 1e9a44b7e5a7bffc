"""Nodes apart from one another: in processes of their own, on two machines, written by others."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

pytest.importorskip('rclpy')

from command_line import bag_of

from barc_sim.bags import reader as bag
from barc_sim.control.speed import speed_controller
from barc_sim.simulation.closed_loop import closed_loop

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    Start = Callable[..., subprocess.Popen[str]]

DEADLINE = 100.0
PROPORTIONAL_CONTROLLER = Path(__file__).with_name('programs') / 'proportional_controller.py'
ALONE = ('--no-controller', '--realtime-factor', 'max')
RUN = ('-m', 'barc_sim.run', 'acc', '-q', *ALONE)


def output_of(run: subprocess.Popen[str]) -> str:
    """Return what a run has printed that ended as it should."""
    out, err = run.communicate(timeout=DEADLINE)
    assert run.returncode == 0, err
    assert 'Traceback' not in err
    return out.strip()


# In processes of their own


@pytest.mark.usefixtures('ros_domain')
def test_a_controller_in_its_own_process_drives_two_runs_alike(
    start: Start, tmp_path: Path
) -> None:
    start('-m', 'barc_sim', 'node', 'controller')
    expected = closed_loop(distance=5.0)
    for _ in range(2):
        log = bag.read(bag_of(tmp_path, *ALONE, '--distance', '5'))
        assert (log.x.tolist(), log.motor.tolist()) == (
            expected.x.tolist(),
            expected.motor.tolist(),
        )


# In place of our controller


@pytest.mark.usefixtures('ros_domain')
def test_a_controller_written_by_others_drives_a_run(start: Start, tmp_path: Path) -> None:
    run = start(*RUN, '--distance', '10')
    assert run.stderr
    assert 'waiting for a controller that publishes /ecu' in run.stderr.readline()

    start(PROPORTIONAL_CONTROLLER)
    log = bag.read(tmp_path / output_of(run))
    expected = closed_loop(
        controller=speed_controller(kp=1.0, ki=0.0, kd=0.0, limit=100.0), distance=10.0
    )
    assert log.v_x.tolist() == expected.v_x.tolist()
    assert not log.missed.any()


# On two machines


def ip(*words: str) -> None:
    subprocess.run(['ip', *words], check=True, capture_output=True)  # noqa: S607 (there, or skipped)


@pytest.fixture
def machines(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[tuple[str, ...]]]:
    """Return what to put before a command to run it on either of two machines in one subnet."""
    if os.geteuid() or not shutil.which('ip'):
        pytest.skip('two network namespaces need root and the command ip')
    names = [f'barc{os.getpid()}{letter}' for letter in 'ab']
    links = [f'v{os.getpid()}{letter}' for letter in 'ab']
    try:
        try:
            for name in names:
                ip('netns', 'add', name)
            ip('link', 'add', links[0], 'type', 'veth', 'peer', 'name', links[1])
            for number, (name, link) in enumerate(zip(names, links, strict=True), start=1):
                ip('link', 'set', link, 'netns', name)
                ip('-n', name, 'address', 'add', f'10.97.13.{number}/24', 'dev', link)
                ip('-n', name, 'link', 'set', link, 'up')
                ip('-n', name, 'link', 'set', 'lo', 'up')
                ip('-n', name, 'route', 'add', '224.0.0.0/4', 'dev', link)
        except subprocess.CalledProcessError as error:
            pytest.skip(f'no network namespaces here: {error.stderr.decode().strip()}')
        # What each process says for itself is to count.
        monkeypatch.delenv('ROS_AUTOMATIC_DISCOVERY_RANGE')
        yield [('ip', 'netns', 'exec', name) for name in names]
    finally:
        for name in names:
            subprocess.run(['ip', 'netns', 'del', name], check=False, capture_output=True)  # noqa: S607


@pytest.mark.slow
@pytest.mark.usefixtures('ros_domain')
def test_a_run_on_one_machine_is_driven_from_another(
    machines: list[tuple[str, ...]], start: Start, tmp_path: Path
) -> None:
    here, elsewhere = machines
    run = start(*RUN, '--network', '--distance', '10', before=here)
    subnet = ('env', 'ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET')
    start(PROPORTIONAL_CONTROLLER, before=(*elsewhere, *subnet))
    log = bag.read(tmp_path / output_of(run))
    expected = closed_loop(
        controller=speed_controller(kp=1.0, ki=0.0, kd=0.0, limit=100.0), distance=10.0
    )

    assert log.v_x.tolist() == expected.v_x.tolist()
