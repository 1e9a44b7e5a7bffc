"""A real Dask cluster: the same results, whoever does the work, joins or ends."""

from __future__ import annotations

import socket
import threading
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from cluster_work import refuse, square_slowly
from command_line import barc as barc_of
from command_line import printed, refused, wait_for
from rosbag2_layouts import Sent, write_bag
from user_files import CONTROLLER, MODEL, PLAIN_CONTROLLER, PLAIN_MODEL

from barc_sim import identify, simulate, sweep
from barc_sim.__main__ import main as barc
from barc_sim.control.excitation import PRBS
from barc_sim.errors import UserError
from barc_sim.lab.confined.process import ProcessLimits, check_confinement
from barc_sim.parallel.cluster import cluster

distributed = pytest.importorskip('distributed')

from dask_cluster import dask_cluster  # noqa: E402

if TYPE_CHECKING:
    from collections.abc import Iterator

    from dask_cluster import Cluster

pytestmark = [pytest.mark.timeout(300), pytest.mark.xdist_group('cluster')]

WITHOUT_BARC_SIM = Path(__file__).parents[1] / 'without_barc_sim'
KP = np.linspace(1.0, 60.0, 300)


@pytest.fixture(scope='module')
def machines(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    """Return a scheduler with two workers."""
    with dask_cluster(tmp_path_factory.mktemp('cluster'), workers=2) as started:
        yield started


def test_a_sweep_on_a_cluster_has_the_same_bits(machines: Cluster) -> None:
    with cluster(machines.address) as executor:
        shared = sweep(kp=KP, ki=20.0, noise=0.1, executor=executor)
    assert shared.tobytes() == sweep(kp=KP, ki=20.0, noise=0.1).tobytes()


def test_the_pieces_of_a_worker_that_ends_are_done_by_one_that_joins(tmp_path: Path) -> None:
    with dask_cluster(tmp_path, workers=0) as machines, cluster(machines.address) as executor:
        futures = [executor.submit(square_slowly, number) for number in range(20)]
        worker = machines.add_worker()
        assert futures[0].result(60.0) == 0

        machines.kill(worker)
        machines.add_worker()
        assert [future.result(60.0) for future in futures] == [n * n for n in range(20)]


def test_workers_that_cannot_do_the_work_get_none_of_it(
    machines: Cluster, capsys: pytest.CaptureFixture[str]
) -> None:
    with (
        pytest.raises(UserError, match='can do this work: start others'),
        cluster(machines.address, refuse),
    ):
        pass
    assert capsys.readouterr().err.count('gets no work: its kernel is too old') == 2


def test_workers_without_barc_sim_are_named_in_a_sentence(tmp_path: Path) -> None:
    with dask_cluster(tmp_path, workers=0) as machines:
        machines.add_worker(path=[str(WITHOUT_BARC_SIM)])
        wait_for(lambda: 'Registered to' in (tmp_path / '2.log').read_text('utf-8'))
        with (
            pytest.raises(UserError, match='lack barc_sim: install the same version there'),
            cluster(machines.address),
        ):
            pass


@pytest.mark.parametrize('address', ['tcp://127.0.0.1:9', 'nowhere', ''])
def test_an_address_without_a_scheduler_is_refused(address: str) -> None:
    with pytest.raises(UserError, match='there is no Dask scheduler at'), cluster(address):
        pass


@pytest.mark.parametrize('words', [b'SSH-2.0-OpenSSH_9.2p1\r\n', b''])
def test_a_program_of_another_kind_is_refused(words: bytes) -> None:
    with socket.create_server(('127.0.0.1', 0)) as server:

        def answer() -> None:
            with suppress(OSError):
                while True:
                    connection, _ = server.accept()
                    with connection:
                        connection.sendall(words)

        threading.Thread(target=answer, daemon=True).start()
        address = f'tcp://127.0.0.1:{server.getsockname()[1]}'
        with pytest.raises(UserError, match='and no Dask scheduler'), cluster(address):
            pass
        server.shutdown(socket.SHUT_RDWR)


def test_the_address_of_a_worker_is_refused(tmp_path: Path) -> None:
    with dask_cluster(tmp_path, workers=1):
        log = tmp_path / '2.log'
        wait_for(lambda: 'Registered to' in log.read_text('utf-8'))
        address = log.read_text('utf-8').split('Start worker at:')[1].split()[0]
        with pytest.raises(UserError, match='there is a Worker at'), cluster(address):
            pass


def test_an_empty_address_is_refused() -> None:
    assert "no Dask scheduler at ''" in refused('grade', '.', '--scheduler', '')


def test_a_scheduler_that_ends_is_named_in_a_sentence(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    def use(machines: Cluster) -> None:
        with cluster(machines.address) as executor:
            machines.close()
            executor.submit(square_slowly, 2).result(60.0)

    with (
        dask_cluster(tmp_path, workers=1) as machines,
        pytest.raises(UserError, match='has ended: start it and its workers'),
    ):
        use(machines)
    assert 'Traceback' not in capfd.readouterr().err


def test_a_client_in_place_of_its_executor_is_refused(machines: Cluster) -> None:
    with (
        distributed.Client(machines.address, set_as_default=False) as client,
        pytest.raises(UserError, match=r'of a Client of Dask it is client\.get_executor\(\)'),
    ):
        sweep(kp=KP, executor=client)


def write_class(folder: Path, students: int) -> None:
    """Write submissions, right ones and with mistakes."""
    for number in range(students):
        submission = folder / f'student_{number}'
        submission.mkdir(parents=True)
        model = MODEL if number % 3 else PLAIN_MODEL.replace('sin', 'cos', number % 2)
        controller = CONTROLLER if number % 2 else PLAIN_CONTROLLER
        (submission / 'bike_model.py').write_text(model)
        (submission / 'controller.py').write_text(controller)


def files_of(folder: Path) -> dict[str, bytes]:
    """Return the files below a folder, but for the page of the class, which has a random nonce."""
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob('*')
        if path.is_file() and path.name != 'class.html'
    }


@pytest.mark.slow
def test_a_class_on_a_cluster_has_the_same_reports_though_a_worker_ends(
    tmp_path: Path, machines: Cluster
) -> None:
    try:
        check_confinement(ProcessLimits())
    except UserError as error:
        pytest.skip(str(error))
    write_class(tmp_path / 'class', 6)

    ended = machines.add_worker()
    threading.Timer(3.0, machines.kill, (ended,)).start()
    local = ['grade', str(tmp_path / 'class'), '--out', str(tmp_path / 'local'), '--jobs', '2']
    remote = ['grade', str(tmp_path / 'class'), '--out', str(tmp_path / 'remote')]
    assert barc([*remote, '--scheduler', machines.address]) == 0
    assert barc(local) == 0
    assert files_of(tmp_path / 'remote') == files_of(tmp_path / 'local')


@pytest.mark.slow
def test_a_users_controller_is_tuned_on_a_cluster(tmp_path: Path, machines: Cluster) -> None:
    (tmp_path / 'controller.py').write_text(PLAIN_CONTROLLER)
    words = ['tune', '--controller', str(tmp_path / 'controller.py'), '--distance', '10']
    words += ['--ki-range', '0', '0', '--kd-range', '0', '0']
    alone = printed(*words).splitlines()
    shared = printed(*words, '--scheduler', machines.address).splitlines()
    assert len(alone) == len(shared)
    differ = [line for line, other in zip(alone, shared, strict=True) if line != other]
    assert all(' closed loops per road in ' in line for line in differ)


@pytest.mark.slow
def test_bags_are_converted_on_a_cluster(tmp_path: Path, machines: Cluster) -> None:
    bags = []
    for name in ('a', 'b', 'c'):
        messages = [Sent('/words', number, f'{name} {number}') for number in range(9)]
        bags.append(str(write_bag(tmp_path / name, [messages])))
    local = ['convert', *bags, '-o', str(tmp_path / 'local')]
    remote = ['convert', *bags, '-o', str(tmp_path / 'remote'), '--scheduler', machines.address]
    printed(*local)
    assert len(printed(*remote).splitlines()) == 3
    assert files_of(tmp_path / 'remote') == files_of(tmp_path / 'local')

    again = barc_of('convert', str(tmp_path / 'missing'), *remote[1:])
    assert (again.returncode, again.stdout) == (1, '')
    assert again.stderr.count('exists: name a new --output') == 3
    assert f"a worker of the cluster finds no '{tmp_path / 'missing'}'" in again.stderr


@pytest.mark.slow
def test_a_bootstrap_on_a_cluster_has_the_same_bits(machines: Cluster) -> None:
    pytest.importorskip('scipy')
    log = simulate(controller=PRBS(), road='flat', distance=40.0, noise=0.02, delay=0.1)
    with cluster(machines.address) as executor:
        shared = identify(log, bootstrap=60, executor=executor)
    assert shared.estimates == identify(log, bootstrap=60).estimates


def test_the_options_exclude_each_other() -> None:
    words = ('grade', 'folder', '--jobs', '2', '--scheduler', 'tcp://10.0.0.1:8786')
    assert 'not allowed with argument --jobs' in refused(*words)
