"""Submissions that are alike are named, with the share; independent ones are not."""

from __future__ import annotations

from pathlib import Path

import pytest
from student_code import CONTROLLER, MODEL, WORKS
from user_files import CONTROLLER as OTHER_CONTROLLER
from user_files import MODEL as OTHER_MODEL

import barc_sim
from barc_sim.lab.grade.submissions import ALIKE, alike, in_words, passages

PACKAGE = Path(barc_sim.__file__).parent
#: As in the lab's file for ROS 1, which every student has.
ROS_1_LOOP = """
def measurements_callback(data):
    global x, y, psi, v_x, v_y, psi_dot
    x = data.x
    y = data.y
    psi = data.psi
    v_x = data.v_x
    v_y = data.v_y
    psi_dot = data.psi_dot
"""


def of(model: str, controller: str) -> frozenset[int]:
    return passages({'bike_model.py': model.encode(), 'controller.py': controller.encode()})


def disguised(text: str) -> str:
    """Return the code with other names, comments and layout."""
    for old, new in (('self.int_error', 'self.sum'), ('error', 'e'), ('beta', 'b'), (' D ', ' d ')):
        text = text.replace(old, new)
    text = text.replace('        return acc\n', '        # my own work\n\n        return (acc)\n')
    return text.replace('\t', '    ').replace('        l_r', '    l_r')


def test_a_copy_with_other_names_comments_and_layout_is_named() -> None:
    found = alike(
        {
            'ada': of(MODEL, CONTROLLER),
            'bob': of(disguised(MODEL), disguised(CONTROLLER)),
            'eve': of(OTHER_MODEL, OTHER_CONTROLLER),
        }
    )

    ((name, share),) = found['ada']
    assert (name, found['eve']) == ('bob', [])
    assert share > 0.9
    assert found['bob'] == [('ada', share)]


def test_copies_of_the_reference_and_of_the_published_law_are_named() -> None:
    model, pid = (PACKAGE / 'vehicle/bike_model.py', PACKAGE / 'control/speed.py')
    law = WORKS['the published law']

    found = alike(
        {
            'model': of(model.read_text(), OTHER_CONTROLLER),
            'pid': of(MODEL, pid.read_text()),
            'law': of(law.model, law.controller),
        }
    )

    assert found['model'] == [("barc_sim's own code", 1.0)]
    assert found['pid'] == [("barc_sim's own code", 1.0)]
    ((name, share),) = found['law']
    assert name == 'the published law'
    assert ALIKE <= share < 1.0


def test_templates_are_alike_to_nothing() -> None:
    folder = PACKAGE / 'lab' / 'templates'
    template = passages({file.name: file.read_bytes() for file in folder.glob('*/*.py')})

    assert template == frozenset()
    assert alike({'ada': template, 'bob': template}) == {'ada': [], 'bob': []}


def test_what_most_of_a_class_has_is_the_handouts() -> None:
    main = CONTROLLER[CONTROLLER.index('def controller') :]
    works = {f's{k}': of(f'x = {k}\n' * k, main) for k in range(12)}

    assert not any(alike(works).values())
    assert not any(alike(dict([*works.items()][:3])).values())
    assert any(alike(dict([*works.items()][:2])).values())


@pytest.mark.parametrize('others', [1, 2, 3])
def test_three_who_copy_one_another_are_found_in_a_small_class(others: int) -> None:
    copies = {f'c{k}': of(MODEL, CONTROLLER) for k in range(3)}
    works = {f's{k}': of(f'x = {k}\n' * 60 * (k + 1), '') for k in range(others)}

    found = alike(copies | works)

    assert [len(found[name]) for name in copies] == [2, 2, 2]


def test_a_pair_is_found_beside_any_handout() -> None:
    main = CONTROLLER[CONTROLLER.index('def controller') :]
    own = of(MODEL, OTHER_CONTROLLER)
    works = {f's{k}': of(f'x = {k}\n' * k, main) for k in range(6)}

    found = alike(works | {'ada': own | works['s0'], 'bob': own | works['s1']})

    assert (found['ada'], found['bob']) == ([('bob', 1.0)], [('ada', 1.0)])


def test_the_labs_file_for_ros_1_is_no_evidence() -> None:
    assert len(of('', ROS_1_LOOP)) == 0


def test_many_are_counted() -> None:
    others = [(f's{k}', 1.0 - k / 100) for k in range(5)]

    assert in_words(others) == 's0 100%, s1 99%, s2 98% and 2 more'
    assert in_words([]) == ''


@pytest.mark.parametrize(
    'text', ['def f(:', '"""', 'x = (', '\t  x\n \ty', 'print "a"', '\0', '\\', '€ = $', "f'{'"]
)
def test_code_with_errors_is_taken_as_far_as_it_can_be_read(text: str) -> None:
    whole = of(MODEL, CONTROLLER)

    assert whole <= of(MODEL, CONTROLLER + text)
    assert of(text, text) == frozenset()
