"""Submissions that are alike: the share of passages that they have in common.

A passage is `PASSAGE` tokens of Python in a row. Comments, docstrings, layout and the choice of
names do not count. Those of the handouts are left out: the templates', those of the lab's files for
ROS 1 (which `known/handout.txt` has as hashes), and those of most of a class.
"""

from __future__ import annotations

import io
import keyword
import tokenize
import zlib
from collections import Counter
from functools import cache
from importlib import resources
from itertools import combinations
from typing import TYPE_CHECKING

from barc_sim.lab.handout import HANDOUTS

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    Passages = frozenset[int]

#: Tokens of a passage: about two lines of code.
PASSAGE = 20
#: Passages of a submission; one with fewer is not compared, as it is too short.
LEAST = 40
#: Two are alike where the one with fewer passages has this share of them in common.
ALIKE = 0.7
#: A passage that so many submissions, and more than this share, have is the handout's; in a class
#: of three, that all have.
EVERYBODYS, EVERYBODYS_SHARE = 4, 0.5
_NAMED = 3  # of a submission, the most alike
_MAX_CHARACTERS = 100_000  # of a file
_LAYOUT = (tokenize.COMMENT, tokenize.NL, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER)
#: What anybody can copy: the file in this package, and its name in the list.
_KNOWN = {
    'the published law': ('lab/grade/known/published_law.txt',),
    "barc_sim's own code": ('vehicle/bike_model.py', 'control/pid.py', 'control/lane.py'),
}


def passages(files: Mapping[str, bytes]) -> Passages:
    """Return the passages of a submission's Python files, hashed, without the handouts'."""
    return _passages(files) - _of_handouts()


def alike(submissions: Mapping[str, Passages]) -> dict[str, list[tuple[str, float]]]:
    """Return for each submission those that are alike, and the share, the greatest first.

    Among them are the published law and barc_sim's own code.
    """
    counts = Counter(passage for each in submissions.values() for passage in each)
    least, share = min(EVERYBODYS, max(len(submissions), 3)), EVERYBODYS_SHARE * len(submissions)
    everybodys = {passage for passage, n in counts.items() if n >= least and n > share}
    own = {name: each - everybodys for name, each in submissions.items()}
    found: dict[str, list[tuple[str, float]]] = {name: [] for name in submissions}
    for one, other in combinations(own, 2):
        share = _share(own[one], own[other])
        if share >= ALIKE:
            found[one].append((other, share))
            found[other].append((one, share))
    for name, each in submissions.items():
        for title, known in _known().items():
            # A copy of one of its files is enough.
            share = max(_share(each, file) for file in known)
            if share >= ALIKE:
                found[name].append((title, share))
    for others in found.values():
        others.sort(key=lambda pair: (-pair[1], pair[0]))
    return found


def in_words(others: list[tuple[str, float]]) -> str:
    """Return those that a submission is alike, with the share, in one line."""
    named = ', '.join(f'{name} {share:.0%}' for name, share in others[:_NAMED])
    more = len(others) - _NAMED
    return f'{named} and {more} more' if more > 0 else named


def _share(one: Passages, other: Passages) -> float:
    smaller = min(len(one), len(other))
    return len(one & other) / smaller if smaller >= LEAST else 0.0


def _passages(files: Mapping[str, bytes]) -> Passages:
    return frozenset(
        passage
        for name, data in files.items()
        if name.endswith('.py')
        for passage in _of_text(data.decode(errors='replace')[:_MAX_CHARACTERS])
    )


def _of_text(text: str) -> Iterator[int]:
    tokens = [*_tokens(text)]
    for start in range(len(tokens) - PASSAGE + 1):
        numbers: dict[str, str] = {}
        # A name is the number of its first place, so that renaming changes nothing.
        words = [
            numbers.setdefault(token, f'#{len(numbers)}')
            if token.isidentifier() and not keyword.iskeyword(token)
            else token
            for token in tokens[start : start + PASSAGE]
        ]
        yield zlib.crc32(' '.join(words).encode())


def _tokens(text: str) -> Iterator[str]:
    """Yield the tokens of Python code without layout, up to its first error."""
    # Without indentation, which no error can be in then.
    lines = io.StringIO('\n'.join(line.strip() for line in text.splitlines()) + '\n')
    before = ''
    waiting = ''  # a string that can be a docstring
    try:
        for token in tokenize.generate_tokens(lines.readline):
            if token.type in _LAYOUT:
                continue
            word = ';' if token.type == tokenize.NEWLINE else token.string
            if waiting and word != ';':
                yield waiting
            if waiting and word == ';':
                waiting, before = '', ';'
                continue
            waiting = ''
            if token.type == tokenize.STRING:
                word = '""'
                if before in ('', ';'):
                    waiting = word
                    continue
            yield word
            before = word
    except (tokenize.TokenError, SyntaxError):
        return


@cache
def _of_handouts() -> Passages:
    file = resources.files('barc_sim.lab.grade').joinpath('known/handout.txt')
    hashes = file.read_text(encoding='utf-8').split()
    own = (_passages(each.templates()) for each in HANDOUTS.values())
    return frozenset().union(*own) | {int(each, 16) for each in hashes}


@cache
def _known() -> dict[str, list[Passages]]:
    package = resources.files('barc_sim')
    return {
        title: [passages({'known.py': (package / name).read_bytes()}) for name in names]
        for title, names in _KNOWN.items()
    }
