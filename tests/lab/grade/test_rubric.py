"""The rubric: a YAML file, or one sentence."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from barc_sim.errors import UserError
from barc_sim.lab.files import RUBRICS
from barc_sim.lab.grade.grade import load_rubric

if TYPE_CHECKING:
    from pathlib import Path


def loaded(path: Path, text: str) -> object:
    file = path / 'rubric.yaml'
    file.write_text(text)
    return load_rubric(file)


@pytest.mark.parametrize('name', RUBRICS)
def test_a_rubric_that_ships_gives_100_points(name: str) -> None:
    rubric = load_rubric(name)
    assert sum(v for each, v in rubric.points.items() if each not in rubric.optional) == 100.0


def test_criteria_that_are_left_out_or_worth_nothing_do_not_count(tmp_path: Path) -> None:
    file = tmp_path / 'rubric.yaml'
    file.write_text('seed: 7\ncriteria: {pid.integral: 2.5, model.x: 1, model.y: 0}\n')

    rubric = load_rubric(file)

    assert rubric.settings.seed == 7
    assert [*rubric.points.items()] == [('model.x', 1.0), ('pid.integral', 2.5)]


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ('', 'it is None: expected lines'),
        ('a: [', 'is not YAML'),
        ('- 1', 'it is [1]: expected lines'),
        ('seed: 1', 'there is no key criteria'),
        ('seed: 1\nweights: {}', "'weights' is unknown: expected one of title, seed"),
        ('criteria:\n  model.z: 1', "'model.z' is unknown: expected one of model.x"),
        ('criteria:\n  model.x: -1', 'model.x is -1: expected points from 0'),
        ('criteria:\n  model.x: many', "model.x is 'many'"),
        ('criteria:\n  model.x: .nan', 'model.x is nan'),
        ('criteria:\n  model.x: true', 'model.x is True'),
        ('criteria:\n  model.x: [1]', 'model.x is [1]'),
        ('criteria:\n  model.x: 0', 'no criterion has points'),
        ('criteria: 3', 'criteria is 3: expected lines'),
        (
            'criteria: {model.x: 1}\ntask_3: {model.x: 1}',
            'is in criteria and in task_3',
        ),
        (
            'criteria: {model.x: 1}\nthresholds: {full_rms: 2}',
            'full_rms is 2: expected less than zero_rms, 1.5',
        ),
        ('seed: 1.5', 'seed is 1.5: expected a whole number from 0 on'),
        ('title: 3', 'title is 3: expected a text'),
        ('visibility: everybody', "visibility is 'everybody': expected one of visible, hidden"),
        ('seed: !!python/object:os.system 1', 'is not YAML'),
    ],
)
def test_a_wrong_rubric_is_refused_with_file_and_cause(
    tmp_path: Path, text: str, message: str
) -> None:
    with pytest.raises(UserError) as error:
        loaded(tmp_path, text)

    assert message in str(error.value)
    assert 'rubric.yaml' in str(error.value)


def test_a_file_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"rubric '.*none.yaml' cannot be read: No such file"):
        load_rubric(tmp_path / 'none.yaml')
    (tmp_path / 'rubric.yaml').write_bytes(b'\xff\xfe\x00')
    with pytest.raises(UserError, match=r"rubric '.*rubric.yaml': it is no text in UTF-8"):
        load_rubric(tmp_path / 'rubric.yaml')
