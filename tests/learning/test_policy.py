"""A policy as a steering law: the environment's trajectory, from a function and from ONNX."""

from __future__ import annotations

from base64 import b64decode
from typing import TYPE_CHECKING, Any

import pytest

from barc_sim.errors import UserError
from barc_sim.learning.policy import PolicyLane
from barc_sim.simulation.closed_loop import lap

if TYPE_CHECKING:
    from pathlib import Path

#: A product with the weights of `policy`, in single precision.
ONNX = b64decode(
    'CAg6cQoRCgFvCgF3EgFhIgZNYXRNdWwSAXAqLwgJCAEQAUIBd0okzczMvpqZmb8AAAAAAAAAAGZmhkAAAAAAAAAAAAAA'
    'AAAAAAAAWhMKAW8SDgoMCAESCAoCCAEKAggJYhMKAWESDgoMCAESCAoCCAEKAggBQgQKABAN'
)


def policy(observation: Any) -> list[float]:  # noqa: ANN401 (an array)
    e_y, e_psi, _, _, curvature, *_ = observation
    return [4.2 * curvature - 0.4 * e_y - 1.2 * e_psi]


def test_a_policy_drives_a_run_as_its_environment() -> None:
    gymnasium = pytest.importorskip('gymnasium', reason='needs the extra gym')
    options: dict[str, Any] = {'track': 'oval', 'dynamics': 'dynamic', 'delay': 0.05}
    log = lap(PolicyLane(policy), laps=1, **options)
    env = gymnasium.make('barc_sim.learning:barc_sim/Lane-v0', **options)
    observation, info = env.reset(options={'s': 0.0, 'e_y': 0.0, 'e_psi': 0.0, 'v': 0.0})
    for s, e_y in zip(log.s.tolist(), log.e_y.tolist(), strict=True):
        assert (info['s'], info['e_y']) == (s, e_y)
        observation, _, _, _, info = env.step(policy(observation))


def test_an_onnx_file_steers_as_the_function_that_it_holds(tmp_path: Path) -> None:
    pytest.importorskip('onnxruntime', reason='needs the extra onnx')
    file = tmp_path / 'policy.onnx'
    file.write_bytes(ONNX)
    arguments = 0.3, -0.1, 6.0, lambda d: 0.05 if d < 5.0 else 0.0
    steer = PolicyLane(file).steer_calculate(*arguments)
    assert steer == pytest.approx(PolicyLane(policy).steer_calculate(*arguments), abs=1e-6)


def test_a_file_that_is_no_policy_is_refused(tmp_path: Path) -> None:
    (tmp_path / 'policy.onnx').write_text('none')
    with pytest.raises(UserError, match=r'policy\.onnx'):
        PolicyLane(tmp_path / 'policy.onnx')
