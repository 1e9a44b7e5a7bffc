"""A grade as Gradescope reads it.

https://gradescope-autograders.readthedocs.io/en/latest/specs/
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from barc_sim.lab.grade.labels import label

if TYPE_CHECKING:
    from barc_sim.lab.grade.grade import Grade


def results(grade: Grade) -> str:
    """Return the text of `results.json`."""
    tests = [
        {
            'name': label(item.criterion),
            'number': item.criterion,
            'score': item.points,
            'max_score': item.max_points,
            'status': 'passed' if item.points == item.max_points else 'failed',
            'output': item.message,
            'output_format': 'text',
            'visibility': grade.visibility,
        }
        for item in grade.items
    ]
    content = {
        'score': grade.score,
        'output': '\n'.join(grade.notes),
        'output_format': 'text',
        'visibility': grade.visibility,
        'stdout_visibility': 'hidden',
        'tests': tests,
        'extra_data': {'seed': grade.seed, 'sha256': dict(grade.hashes)},
    }
    return json.dumps(content, ensure_ascii=False, indent=2, allow_nan=False) + '\n'
