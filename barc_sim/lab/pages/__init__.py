"""Renders the HTML pages of reports, grades and a class; each file needs no network."""

from __future__ import annotations

from base64 import b64encode
from functools import cache
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from barc_sim import __version__


def render(page: str, **values: object) -> str:
    """Return the HTML of a page in this folder, with the values put in and escaped."""
    return _environment().get_template(f'{page}.html').render(version=__version__, **values)


def data_url(kind: str, data: bytes) -> str:
    """Return an image of the MIME type `kind` as a URL that contains it."""
    return f'data:{kind};base64,{b64encode(data).decode()}'


@cache
def _environment() -> Environment:
    return Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
