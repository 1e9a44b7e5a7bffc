"""The commands `barc new` and `barc submit`: the templates, and one zip that `grade` takes."""

from __future__ import annotations

import zipfile
from typing import TYPE_CHECKING

import pytest
from command_line import barc, refused
from hand_drive import drive_by_hand
from made_bags import make
from student_code import CONTROLLER, MODEL

from barc_sim.__main__ import main, run
from barc_sim.control.driver import DriverInput
from barc_sim.simulation.closed_loop import simulate

if TYPE_CHECKING:
    from pathlib import Path

OWN = {
    'bike_model.py': MODEL,
    'controller.py': CONTROLLER,
    'relay.py': 'def relay(linear_x, angular_z):\n    return [4.0 * linear_x, 0.3 * angular_z]\n',
    'description.md': 'I tuned it by hand.\n',
    'gains.csv': '10,0.5,0.4\n',
}


@pytest.fixture
def lab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a student's folder, in the current one."""
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / 'lab'
    folder.mkdir()
    for name, text in OWN.items():
        (folder / name).write_text(text)
    return folder


def teleop_bag(path: Path) -> Path:
    log = drive_by_hand([(0.0, DriverInput(1.0, 0.3))], 1.0)
    return make(path, log, {'command': 'barc teleop --lab lab'})


def test_everything_is_in_the_zip(lab: Path) -> None:
    (lab / 'bags').mkdir()
    teleop_bag(lab / 'bags' / 'drive')
    (lab / 'drive.mp4').write_bytes(bytes(2 << 20))

    process = barc('submit', 'lab')

    assert (process.returncode, process.stderr) == (0, '')

    with zipfile.ZipFile('lab.zip') as archive:
        names = archive.namelist()
        summary = archive.read('summary.txt').decode()
        assert archive.read('controller.py') == CONTROLLER.encode()
        assert b'--bag-dir' not in archive.read('report.html')
    expected = {
        *OWN, 'report.html', 'teleop.html', 'summary.txt', 'drive.mp4',
        'course/metadata.yaml',
    }  # fmt: skip
    assert expected <= {*names}
    assert [name for name in names if name.startswith('teleop/') and name.endswith('.mcap')]
    assert process.stdout.startswith(summary)
    assert 'the RMS error is 0.101 m/s, the maximum 0.367 m/s' in summary
    assert 'teleop        1.0 s by hand (barc teleop --lab lab)' in summary
    assert [line for line in summary.splitlines() if 'missing' in line] == [
        'code          missing: compose.py'
    ]


@pytest.mark.usefixtures('lab')
def test_a_zip_that_grade_does_not_open_is_named(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr('barc_sim.lab.submission.MAX_ARCHIVE', 1000)
    run('submit', ['lab'])
    fault = 'barc grade does not read it: it is larger than 0 MiB: leave the video out'
    assert fault in capsys.readouterr().out


def test_a_link_in_a_strangers_bag_is_not_packed(lab: Path) -> None:
    secret = lab.parent / 'secret.mp4'
    secret.write_text('mine\n')
    bag = teleop_bag(lab.parent / 'drive')
    (bag / 'metadata.yaml').unlink()
    (bag / 'metadata.yaml').symlink_to(secret)
    words = ('submit', 'lab', '--teleop', str(bag))
    assert refused(*words).endswith('is a link, where a regular file is expected: name another')
    assert not (lab.parent / 'lab.zip').exists()


def test_each_missing_part_of_a_submission_has_a_line(lab: Path) -> None:
    for name in OWN.keys() - {'relay.py'}:
        (lab / name).unlink()

    process = barc('submit', 'lab', '--save', 'mine.zip')

    assert process.returncode == 0
    missing = [line for line in process.stdout.splitlines() if 'missing: ' in line]
    parts = ['code'] * 3 + ['course', 'teleop', 'video', 'description']
    assert [line.split()[0] for line in missing] == parts
    assert zipfile.ZipFile('mine.zip').namelist() == ['relay.py', 'summary.txt']


def test_a_drive_of_a_controller_is_not_one_by_hand(lab: Path) -> None:
    bag = make(lab.parent / 'course', simulate(distance=1.0), {'command': 'barc acc'})
    process = barc('submit', 'lab', '--teleop', str(bag))
    assert '(barc acc): name a drive by hand' in process.stdout
    assert not [n for n in zipfile.ZipFile('lab.zip').namelist() if n.startswith('teleop')]


def test_code_that_fails_is_packed_with_its_bag_and_the_sentence(lab: Path) -> None:
    text = CONTROLLER.replace('return acc', 'return acc if error > 1.0 else missing')
    (lab / 'controller.py').write_text(text)

    process = barc('submit', 'lab')

    assert process.returncode == 0
    assert 'course        missing: the drive failed: controller.py, line' in process.stdout
    assert "NameError: name 'missing' is not defined" in process.stdout
    assert [name for name in zipfile.ZipFile('lab.zip').namelist() if name.endswith('.mcap')]


@pytest.mark.usefixtures('lab')
def test_unchanged_templates_are_named() -> None:
    assert barc('new', 'fresh').returncode == 0

    process = barc('submit', 'fresh', '--teleop', 'nowhere')

    assert 'missing: relay.py is still the template' in process.stdout
    assert "teleop        missing: there is no bag 'nowhere'" in process.stdout
    assert 'video         missing: save one in your folder' in process.stdout
    assert 'description   missing: ' in process.stdout


@pytest.mark.parametrize(
    ('words', 'sentence'),
    [
        (['nowhere'], "there is no folder 'nowhere': name the one with your files; barc new"),
        (['.'], "the folder '.' has no bike_model.py, controller.py, relay.py"),
        (['lab/controller.py'], "'lab/controller.py' is a file: name the folder that it is in"),
        (['lab', '--save', 'lab.rar'], "cannot save 'lab.rar': the name must end in .zip"),
        (['lab', '--save', 'no/lab.zip'], "cannot save 'no/lab.zip': No such file or directory"),
    ],
)
@pytest.mark.usefixtures('lab')
def test_submit_refuses_a_mistake_in_a_sentence(words: list[str], sentence: str) -> None:
    assert sentence in refused('submit', *words)


TEMPLATES = ['README.md', 'bike_model.py', 'compose.py', 'controller.py', 'relay.py']


def test_a_new_folder_has_the_templates_and_the_next_command_is_printed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(['new', str(tmp_path / 'my lab')]) == 0
    assert sorted(path.name for path in (tmp_path / 'my lab').iterdir()) == TEMPLATES
    assert f"bin/barc acc --lab '{tmp_path}/my lab'" in capsys.readouterr().out
    readme = (tmp_path / 'my lab' / 'README.md').read_text()
    assert all(name in readme for name in TEMPLATES[1:])


@pytest.mark.parametrize('name', TEMPLATES)
def test_no_file_is_overwritten(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text('mine')
    assert f'already has {name}' in refused('new', str(tmp_path))
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert (tmp_path / name).read_text() == 'mine'


@pytest.mark.parametrize('place', ['{file}', '{file}/lab', '/proc/lab'])
def test_a_place_that_cannot_be_written_to_is_named(tmp_path: Path, place: str) -> None:
    file = tmp_path / 'file'
    file.write_text('')
    assert refused('new', place.format(file=file))
