"""What students hand in, read with care."""

from __future__ import annotations

import os
import resource
import threading
import zipfile
from typing import TYPE_CHECKING

import pytest
from bombs import BOMBS

from barc_sim.cli.files import HeldFolder
from barc_sim.errors import UserError
from barc_sim.lab.confined.process import ProcessLimits
from barc_sim.lab.grade.grade import grade, load_rubric
from barc_sim.lab.submission import MAX_ENTRIES, MAX_FILE, MAX_FILES, find, listed, read_submission

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path


def only_the_controller(path: Path) -> tuple[str, ...]:
    """Return the notes on a submission of which `controller.py` alone is read."""
    submission = read_submission(path)
    assert [*submission.files] == ['controller.py']
    return submission.notes


def test_a_file_of_a_similar_name_is_found_as_it_is_by_check(
    folder: Callable[..., Path], tmp_path: Path
) -> None:
    path = folder(controller_final='')
    archive = zipped(tmp_path / 'eve.zip', **{'lab/Bike_Model.py': b'1', 'controller/a.py': b''})

    assert find(path) == [path]
    assert read_submission(archive).files == {'Bike_Model.py': b'1'}


@pytest.mark.parametrize('is_archive', [False, True])
def test_code_in_a_folder_within_is_found(tmp_path: Path, *, is_archive: bool) -> None:
    path = tmp_path / 'eve.zip'
    files = {'lab/relay.py': b'1', 'lab/data/a.csv': b'2', 'lab/old/relay.py': b'3', 'b.txt': b'4'}
    if is_archive:
        zipped(path, **files)
    for name in () if is_archive else files:
        (path / name).parent.mkdir(parents=True, exist_ok=True)
        (path / name).write_bytes(files[name])
    submission = read_submission(path)

    assert submission.files == {'relay.py': b'1', 'data/a.csv': b'2', 'old/relay.py': b'3'}
    assert submission.notes == ('lab/old/relay.py is not graded, because lab/relay.py is',)


def test_the_pictures_of_a_film_do_not_hide_the_code(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr('barc_sim.lab.submission.MAX_ENTRIES', 3)
    for name in ('film/1.png', 'film/2.png', 'film/3.png', 'lab/relay.py'):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    assert read_submission(tmp_path).files == {'relay.py': b''}


def test_the_packages_of_an_environment_are_not_counted(tmp_path: Path) -> None:
    names = [f'lab/.venv/{i}.py' for i in range(MAX_ENTRIES + 1)]
    path = zipped(tmp_path / 'eve.zip', **dict.fromkeys(names, b''), **{'lab/relay.py': b'1'})
    submission = read_submission(path)
    assert (submission.files, submission.notes) == ({'relay.py': b'1'}, ())


def test_an_archive_in_a_folder_without_code_is_read(
    folder: Callable[..., Path], tmp_path: Path
) -> None:
    zipped(folder('ada') / 'lab.zip', **{'relay.py': b'1'})
    zipped(folder('bob', controller='') / 'bags.zip', **{'old/relay.py': b'1'})
    (folder('eve') / 'lab.zip').symlink_to(tmp_path / 'ada' / 'lab.zip')

    assert read_submission(tmp_path / 'ada').name == 'ada'
    assert read_submission(tmp_path / 'ada').files == {'relay.py': b'1'}
    assert only_the_controller(tmp_path / 'bob') == ()
    assert read_submission(tmp_path / 'eve').notes == (
        'it is a link, which is not followed: hand in a .zip or a folder',
    )


def test_a_link_that_the_grader_names_is_followed(
    folder: Callable[..., Path], tmp_path: Path
) -> None:
    path = folder(controller='')
    (tmp_path / 'link').symlink_to(path)

    assert find(tmp_path / 'link') == find(path) == [path]
    assert only_the_controller(*find(tmp_path / 'link')) == ()


def test_every_entry_of_a_folder_is_a_submission(
    folder: Callable[..., Path], tmp_path: Path
) -> None:
    files = [tmp_path / name for name in ('eve.zip', 'gus.rar', 'hal.py')]
    paths = [folder('ada', bike_model=''), folder('bob'), *files]
    for file in files:
        file.touch()
    folder('.hidden', bike_model='')
    (tmp_path / 'submission_metadata.yml').touch()

    assert find(tmp_path) == paths


def test_a_folder_of_one_folder_is_one_submission(
    folder: Callable[..., Path], tmp_path: Path
) -> None:
    path = folder('lab', bike_model='1')
    (tmp_path / 'README.md').touch()

    assert find(tmp_path) == [tmp_path]
    assert find(tmp_path, is_class=True) == [tmp_path / 'README.md', path]
    assert read_submission(tmp_path).files == {'bike_model.py': b'1'}


def test_a_folder_of_one_archive_is_a_class_of_one(tmp_path: Path) -> None:
    path = tmp_path / 'ada.zip'
    path.touch()

    assert find(tmp_path) == [path]


def test_a_path_without_a_submission_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match='is not a submission and contains none'):
        find(tmp_path)
    with pytest.raises(UserError, match=r"there is no folder '.*nowhere': name one submission"):
        find(tmp_path / 'nowhere')
    (tmp_path / 'relay.py').touch()
    with pytest.raises(UserError, match=r"relay.py' is a file: name one submission"):
        find(tmp_path / 'relay.py')


def test_a_folder_gives_its_own_files_and_a_note_on_what_is_none(
    folder: Callable[..., Path], tmp_path: Path
) -> None:
    neighbour = folder('neighbour', bike_model='right')
    path = folder(controller='1', helper='2')
    for name in ('data/gains.csv', '__pycache__/helper.pyc', '.git/config', '.DS_Store'):
        (path / name).parent.mkdir(exist_ok=True)
        (path / name).write_text('3')
    for name in ('course.mcap', 'metadata.yaml', 'speed.PNG', 'teleop.mp4'):
        (path / name).write_bytes(bytes(MAX_FILE + 1))
    (path / 'bike_model.py').symlink_to(neighbour / 'bike_model.py')
    (path / 'others').symlink_to(neighbour)
    os.mkfifo(path / 'relay.py')
    (tmp_path / 'link').symlink_to(neighbour)

    submission, link = read_submission(path), read_submission(tmp_path / 'link')

    assert submission.files == {'controller.py': b'1', 'helper.py': b'2', 'data/gains.csv': b'3'}
    assert submission.notes == (
        'bike_model.py is a link, which is not followed',
        'others is a link, which is not followed',
        'relay.py is not a regular file',
    )
    assert (link.name, link.files) == ('link', {})
    assert link.notes == ('it is a link, which is not followed: hand in a .zip or a folder',)


@pytest.mark.parametrize('is_archive', [False, True])
def test_of_too_many_files_the_top_ones_are_read(tmp_path: Path, *, is_archive: bool) -> None:
    names = [f'a/b/{i}' for i in range(MAX_ENTRIES + 1)] + ['controller.py']
    path = tmp_path / 'eve.zip'
    if is_archive:
        zipped(path, **dict.fromkeys(names, b''))
    for name in () if is_archive else names:
        (path / name).parent.mkdir(parents=True, exist_ok=True)
        (path / name).touch()

    submission = read_submission(path)

    assert len(submission.files) == MAX_FILES
    assert 'controller.py' in submission.files
    assert submission.notes == ('there are more than 200 files or 8 MiB: the rest is left out',)


def zipped(path: Path, **files: bytes) -> Path:
    with zipfile.ZipFile(path, 'w', zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return path


def test_an_archive_is_read_from_where_its_files_are_and_nothing_leads_out(tmp_path: Path) -> None:
    path = tmp_path / 'eve.zip'
    link = zipfile.ZipInfo('lab/src/link.py')
    link.external_attr = 0o120777 << 16
    files = {'lab/src/bike_model.py': b'1', 'lab/src/sub/a.py': b'2', 'lab/notes.txt': b'3'}
    zipped(path, **files, **{'../b.py': b'', '/tmp/a.py': b'', 'lab/src/zeros': bytes(100 << 20)})  # noqa: S108
    with zipfile.ZipFile(path, 'a') as archive:
        archive.writestr(link, '/etc/passwd')

    submission = read_submission(path)

    assert submission.files == {'bike_model.py': b'1', 'sub/a.py': b'2'}
    assert submission.name == 'eve.zip'
    assert submission.notes == (
        '../b.py leads out of the archive',
        '/tmp/a.py leads out of the archive',  # noqa: S108
        'zeros is larger than 1 MiB',
        'link.py is a link, which is not followed',
    )


@pytest.mark.parametrize(('name', 'data', 'note'), [
    ('eve.zip', b'', 'it cannot be read: '),
    ('eve.zip', b'PK\x03\x04 but no more', 'it cannot be read: '),
    ('eve.rar', b'', 'a single .rar file cannot be graded: hand in a .zip'),
    ('controller.py', b'class PID: pass', 'a single .py file cannot be graded: hand in a .zip'),
])  # fmt: skip
def test_a_file_that_cannot_be_graded_has_a_note(
    tmp_path: Path, name: str, data: bytes, note: str
) -> None:
    (tmp_path / name).write_bytes(data)

    assert read_submission(tmp_path / name).files == {}
    assert read_submission(tmp_path / name).notes[0].startswith(note)


@pytest.mark.parametrize('files', [{}, {'plot.png': b'a picture'}, {'.': b'no name'}])
def test_an_empty_submission_has_a_remark(tmp_path: Path, files: dict[str, bytes]) -> None:
    assert read_submission(zipped(tmp_path / 'eve.zip', **files)).notes == (
        'it contains no file to grade',
    )


def test_the_files_of_another_lab_have_a_remark(tmp_path: Path) -> None:
    other = read_submission(zipped(tmp_path / 'eve.zip', **{'lane.py': b''}))
    assert grade(other, load_rubric('lab'), ProcessLimits(confined=False)).notes[0] == (
        'it has no bike_model.py, controller.py, relay.py'
    )


def test_an_empty_folder_has_a_remark(folder: Callable[..., Path]) -> None:
    assert read_submission(folder()).notes == ('it contains no file to grade',)


@pytest.mark.parametrize('name', BOMBS)
def test_an_archive_that_is_too_much_has_one_sentence(tmp_path: Path, name: str) -> None:
    make_bomb, sentence = BOMBS[name]
    (tmp_path / 'bomb.zip').write_bytes(make_bomb())
    before = resource.getrusage(resource.RUSAGE_SELF)

    submission = read_submission(tmp_path / 'bomb.zip')

    after = resource.getrusage(resource.RUSAGE_SELF)
    assert submission.files == {}
    assert len(submission.notes) == 1
    assert sentence in submission.notes[0]
    assert after.ru_utime + after.ru_stime < before.ru_utime + before.ru_stime + 1.0
    assert after.ru_maxrss < before.ru_maxrss + (20 << 10)


def test_a_pipe_with_the_name_of_an_archive_does_not_hang(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / 'pipe.zip')
    (path,) = find(tmp_path / 'pipe.zip')
    assert read_submission(path).notes == ('it is not a regular file: hand in a .zip or a folder',)


@pytest.mark.parametrize(('names', 'note'), [
    (('a', 'a/b'), 'a/b is there twice: the first one is used'),
    (('a/b', 'a'), 'a/b is there twice: the first one is used'),
    (('x/' * 100 + 'y',), 'has a name that no file can have: at most 200 bytes'),
    (('a', 'a'), 'a is there twice: the first one is used'),
    (('old/controller.py',), 'old/controller.py is not graded, because controller.py is'),
])  # fmt: skip
@pytest.mark.filterwarnings('ignore:Duplicate name')
def test_files_that_cannot_be_written_are_left_out(
    tmp_path: Path, names: tuple[str, ...], note: str
) -> None:
    path = tmp_path / 'eve.zip'
    with zipfile.ZipFile(path, 'w') as archive:
        for name in ('controller.py', *names):
            archive.writestr(name, name)

    submission = read_submission(path)
    (tmp_path / 'copy').mkdir()
    submission.write(tmp_path / 'copy')

    assert submission.files['controller.py'] == b'controller.py'
    assert note in ' '.join(submission.notes)


def test_a_damaged_file_of_an_archive_is_named(tmp_path: Path) -> None:
    path = zipped(tmp_path / 'eve.zip', **{'controller.py': b'x' * 1000})
    data = bytearray(path.read_bytes())
    data[45:50] = b'\xff' * 5
    path.write_bytes(data)

    assert read_submission(path).notes[0].startswith('controller.py cannot be read: ')


def test_a_name_cannot_steer_a_terminal(tmp_path: Path) -> None:
    path = tmp_path / '\x1b[2Jeve'
    path.mkdir()

    assert read_submission(path).name == '\\x1b[2Jeve'


def exchange(folder: Path, other: Path) -> None:
    """Put a link to `other` in the place of a folder, or the folder in the place of the link."""
    real = folder.with_name(f'{folder.name}.real')
    if folder.is_symlink():
        folder.unlink()
        real.rename(folder)
    else:
        folder.rename(real)
        folder.symlink_to(other)


@pytest.fixture
def secret(tmp_path: Path) -> Path:
    """Return a folder of the grader, with the names of a submission's files."""
    secret = tmp_path / 'secret'
    secret.mkdir()
    (secret / 'relay.py').write_text('secret')
    zipped(secret / 'lab.zip', **{'relay.py': b'secret'})
    return secret


def test_a_folder_that_becomes_a_link_while_it_is_read_shows_no_other_file(
    tmp_path: Path, secret: Path
) -> None:
    lab = tmp_path / 'ada' / 'lab'
    lab.mkdir(parents=True)
    (lab.parent / 'a.py').touch()
    (lab / 'relay.py').write_text('own')
    with HeldFolder(lab.parent) as held_folder:
        members = listed(held_folder)
        assert next(members).path == 'a.py'

        exchange(lab, secret)
        (member,) = members
        assert member.path == 'lab'
        assert member.fault.startswith('cannot be read: ')  # each system has its own words

        exchange(lab, secret)
        _, member = listed(held_folder)
        assert (member.path, member.read(9)) == ('lab/relay.py', b'own')

        exchange(lab, secret)
        with pytest.raises(OSError, match=r'Not a directory|symbolic links'):
            member.read(9)

        exchange(lab.parent, secret)  # the folder that is held stays the same
        assert [each.path for each in listed(held_folder)] == ['a.py', 'lab', 'lab.real/relay.py']


def test_folders_that_are_exchanged_all_the_time_show_no_other_file(
    tmp_path: Path, secret: Path
) -> None:
    folder = tmp_path / 'class' / 'ada'
    (folder / 'lab').mkdir(parents=True)
    (folder / 'lab' / 'relay.py').write_text('own')
    packed = tmp_path / 'class' / 'eve'
    packed.mkdir()
    zipped(packed / 'lab.zip', **{'relay.py': b'own'})
    over = threading.Event()

    def exchange_all() -> None:
        while not over.is_set():
            for source in (folder / 'lab', folder, packed):
                exchange(source, secret)
                exchange(source, secret)

    thread = threading.Thread(target=exchange_all)
    thread.start()
    try:
        contents = [
            read_submission(path).files.get('relay.py')
            for _ in range(400)
            for path in (folder, packed)
        ]
    finally:
        over.set()
        thread.join()

    assert {*contents} <= {b'own', None}
    assert b'own' in contents


def test_an_archive_in_an_archive_is_read(tmp_path: Path) -> None:
    inner = zipped(tmp_path / 'inner.zip', **{'lab/relay.py': b'1'})
    outer = zipped(tmp_path / 'eve.zip', **{'eve/lab.zip': inner.read_bytes(), 'eve/a.txt': b''})
    twice = zipped(tmp_path / 'bob.zip', **{'eve.zip': outer.read_bytes()})
    assert read_submission(outer).files == {'relay.py': b'1'}
    assert read_submission(twice).notes == (
        'eve/lab.zip is an archive in an archive in an archive: pack your code once',
    )


def test_a_large_archive_in_an_archive_is_refused(tmp_path: Path) -> None:
    outer = zipped(tmp_path / 'eve.zip', **{'lab.zip': bytes(5 << 20)})
    assert read_submission(outer).notes == (
        'lab.zip is larger than 4 MiB: hand in only your own code',
    )


@pytest.mark.parametrize('is_archive', [False, True])
def test_a_notebook_is_named(tmp_path: Path, *, is_archive: bool) -> None:
    path = tmp_path / ('eve.zip' if is_archive else 'eve')
    if is_archive:
        zipped(path, **{'lab.ipynb': b'{}'})
    else:
        path.mkdir()
        (path / 'lab.ipynb').write_bytes(b'{}')

    assert read_submission(path).notes == (
        'lab.ipynb is a notebook, which is not graded: hand in its code as a .py file',
    )
