"""Nothing that computes the answers is within reach of a submission."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from relays import ROS_2
from user_files import CONTROLLER, MODEL

from barc_sim.control.speed import PID
from barc_sim.errors import UserError
from barc_sim.lab.confined.process import Limits
from barc_sim.lab.grade.grade import grade
from barc_sim.lab.grade.rubric import load
from barc_sim.lab.grade.submissions import read
from barc_sim.lab.labs.pid import HillsCode
from barc_sim.vehicle.bike_model import bikeFE

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

pytestmark = pytest.mark.usefixtures('confinement')

ROW = (1.0, 2.0, 0.3, 7.0, 0.5, 0.2, 0.1, 1900.0, 3.0, 0.1, 0.03)
ANSWER = [float(value) for value in bikeFE(*ROW)]
_PID = PID(2.0, 3.0, 0.01)
OUTPUTS = [_PID.acc_calculate(8.0, 7.0, 0.02), _PID.acc_calculate(8.0, 7.5, 0.02)]

#: Looks at all that can be reached, calls what could compute the answers, and reports what does.
WALK = f"""
import gc, inspect, os, sys, types

ROW, ANSWER, OUTPUTS = {tuple(ROW)!r}, {ANSWER!r}, {OUTPUTS!r}
NAMES = {{'bikeFE', 'bike_model', 'resistance', 'KinematicBicycle', 'Plant', 'PID', 'LQR'}}


OWN = open('bike_model.py').read()


def reachable():
    seen, found = set(), []
    frame, frames = sys._getframe(), []
    while frame:
        frames.append(frame)
        frame = frame.f_back
    todo = [list(sys.modules.values()), gc.get_objects(), frames, sys.meta_path, sys.path_hooks,
            sys.path_importer_cache, sys.argv, dict(os.environ), object.__subclasses__()]
    while todo:
        each = todo.pop()
        if id(each) in seen or each is seen or each is found or each is todo:
            continue
        seen.add(id(each))
        found.append(each)
        todo.extend(gc.get_referents(each))
        if isinstance(each, types.FrameType):
            todo += [each.f_globals, each.f_locals, each.f_builtins, each.f_code]
        if isinstance(each, types.FunctionType):
            todo += [each.__globals__, each.__code__, each.__closure__]
    return found


def binds(function, *values):
    try:
        inspect.signature(function).bind(*values)
        return True
    except (TypeError, ValueError):
        return False


def like(values, expected):
    try:
        return all(abs(a - b) < 1e-6 for a, b in zip(values, expected, strict=True))
    except Exception:
        return False


def computes(each):
    if isinstance(each, types.FunctionType) and binds(each, *ROW):
        try:
            if like(each(*ROW), ANSWER):
                return True
        except BaseException:
            pass
    if isinstance(each, type) and binds(each, 2.0, 3.0, 0.01):
        methods = [m for m in vars(each).values() if isinstance(m, types.FunctionType)]
        for method in methods:
            for times in ((), (0.02,)):
                if binds(method, None, 8.0, 7.0, *times):
                    try:
                        pid = each(2.0, 3.0, 0.01)
                        if like([method(pid, 8.0, v, *times) for v in (7.0, 7.5)], OUTPUTS):
                            return True
                    except BaseException:
                        pass
    return False


def report():
    own = {{id(value) for value in globals().values()}}
    found = []
    for each in reachable():
        if id(each) in own:
            continue
        name = getattr(each, '__name__', '')
        if isinstance(each, (types.FunctionType, type, types.ModuleType)):
            if computes(each):
                found.append(f'computes the answers: {{each!r:.20}}')
            module = str(getattr(each, '__module__', name))
            if module.startswith('barc_sim') and str(name).rpartition('.')[2] in NAMES:
                found.append(f'has its name: {{each!r}}')
        if isinstance(each, str) and len(each) > 99 and 'def bikeFE' in each and each != OWN:
            found.append(f'its source: {{each[:80]!r}}')
    for place in [*sys.path, *sys.meta_path, *sys.path_importer_cache]:
        path = str(place)
        if os.path.isdir(path) and 'barc_sim' in os.listdir(path):
            found.append(f'its folder: {{path}}')
    for number in range(3, 64):
        try:
            path = os.readlink(f'/proc/self/fd/{{number}}')
            if path.startswith('/'):
                found.append(f'an open file: {{path}}')
        except OSError:
            pass
    rooms = ('vehicle', 'control', 'simulation', 'lab.judge', 'lab.laws', 'lab.labs', 'lab.grade')
    rooms = tuple(f'barc_sim.{{room}}' for room in rooms)
    found += [name for name in sys.modules if name.startswith(rooms)]
    return found


class Fault(Exception):
    pass


def bikeFE(x, y, psi, v, a, d_f, a0, m, Ff, theta, ts):
    found = sorted(set(report()))
    if found:
        raise Fault('; '.join(found))
    return [1.0, 2.0, 3.0, 4.0]
"""
#: Each gives the answers to whoever can run it.
GRABS = (
    "import sys; bikeFE = sys.modules['barc_sim.vehicle.bike_model'].bikeFE",
    "import sys; bikeFE = sys.modules['barc_sim'].Vehicle; bikeFE(1)",
    'from barc_sim.vehicle.bike_model import bikeFE; 1.0 + bikeFE',
    "import importlib\nbikeFE = importlib.import_module('barc_sim.vehicle.bike_model').bikeFE",
    (
        'import importlib, sys\nfor m in [*sys.modules.values()]:\n'
        " if getattr(m, '__file__', None) and 'barc_sim' in m.__file__:\n"
        "  sys.path.append(m.__file__.partition('/barc_sim/lab')[0])\n"
        "sys.modules['barc_sim'].__path__ = [sys.path[-1] + '/barc_sim']\n"
        "bikeFE = importlib.import_module('barc_sim.vehicle.bike_model').bikeFE"
    ),
    'import os\nbikeFE = open(f"/proc/{os.getppid()}/mem", "rb").read',
)


def test_no_object_in_reach_computes_the_answers(folder: Callable[..., Path]) -> None:
    with HillsCode(folder(bike_model=WALK, relay=ROS_2)) as code:
        code.relay_commands([], 1.0)

        assert code.rows('bikeFE', [ROW], 4) == [(1.0, 2.0, 3.0, 4.0)]


def test_the_walk_finds_what_is_there(folder: Callable[..., Path]) -> None:
    text = f'{MODEL}\n\n{CONTROLLER}'
    with (
        HillsCode(folder(bike_model=f'import hidden\n{WALK}', hidden=text)) as code,
        pytest.raises(UserError, match=r'answers: <class .*computes the answers: <function bikeF'),
    ):
        code.rows('bikeFE', [ROW], 4)


def test_a_model_that_is_grabbed_gets_no_points(folder: Callable[..., Path]) -> None:
    tries = '\n'.join(
        f'try:\n    exec({code!r})\n    print("grabbed")\nexcept BaseException as error:\n'
        '    print(type(error))'
        for code in GRABS
    )

    graded = grade(read(folder(bike_model=tries)), load(), Limits(), sandbox=True)

    assert graded.score == 0.0
    assert graded.printed.count('Error') == len(GRABS)
    assert 'grabbed' not in graded.printed
