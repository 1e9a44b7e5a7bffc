"""The HTML pages of reports, of grades and of a class: whole without a network."""

from __future__ import annotations

from base64 import b64encode
from functools import cache
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from barc_sim import __version__


def render(page: str, **values: object) -> str:
    """Return the page of that name, which is here, as HTML without links; values are escaped."""
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
