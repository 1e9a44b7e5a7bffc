"""Finds the f-strings of a source as Python 3.12 reads them, with an older Python.

From Python 3.12 on, an f-string can contain its own quotes, backslashes and comments within braces.
"""

from __future__ import annotations

import re

_QUOTES = r'(\'\'\'|"""|\'|")'
_F_STRING = re.compile(rf'(?<!\w)(?:[fF][rR]?|[rR][fF]){_QUOTES}')
_STRING = re.compile(rf'[rRbBuU]*{_QUOTES}')


def without_f_strings(text: str) -> str:
    """Return a source with an empty text for each f-string, and its lines where they were.

    From the first f-string that does not end, the source is left as it is.
    """
    parts = []
    at = 0
    while match := _F_STRING.search(text, at):
        end = _end_of_f_string(text, match.end(), match[1])
        if end < 0:
            break
        lines = text.count('\n', match.start(), end)
        parts += [text[at : match.start()], "''", '\\\n' * lines]
        at = end
    return ''.join([*parts, text[at:]])


def _end_of_f_string(text: str, at: int, quotes: str) -> int:
    """Return where an f-string ends, whose contents begin at `at`; -1 if it does not end."""
    while at < len(text):
        pair = text[at : at + 2]
        if text.startswith(quotes, at):
            return at + len(quotes)
        if text[at] == '\n' and len(quotes) == 1:
            return -1
        if text[at] == '{' and pair != '{{':
            at = _end_of_field(text, at + 1)
            if at < 0:
                return -1
        elif text[at] == '\\' or pair in {'{{', '}}'}:
            at += 2
        else:
            at += 1
    return -1


def _end_of_field(text: str, begin: int) -> int:
    """Return where a field in braces ends, whose contents begin at `begin`; -1 if it does not end.

    An empty field has no end: it is an error in every version.
    """
    at = begin
    depth = 1
    while at < len(text):
        if inner := _F_STRING.match(text, at):
            at = _end_of_f_string(text, inner.end(), inner[1])
        elif plain := _STRING.match(text, at):
            at = _end_of_string(text, plain.end(), plain[1])
        else:
            depth += (text[at] in '([{') - (text[at] in ')]}')
            at += 1
        if at < 0:
            return -1
        if not depth:
            return at if text[begin : at - 1].strip() else -1
    return -1


def _end_of_string(text: str, at: int, quotes: str) -> int:
    """Return where a text ends, whose contents begin at `at`; -1 if it does not end."""
    while at < len(text) and not text.startswith(quotes, at):
        if text[at] == '\n' and len(quotes) == 1:
            return -1
        at += 2 if text[at] == '\\' else 1
    return at + len(quotes) if at < len(text) else -1
