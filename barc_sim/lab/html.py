"""Renders the pages of `barc_sim/lab/pages/`; Jinja2 escapes every value."""

from __future__ import annotations

from base64 import b64encode
from functools import cache

from jinja2 import Environment, PackageLoader, StrictUndefined

from barc_sim import __version__


def render(page: str, **values: object) -> str:
    """Return the page called `page` as one HTML file that needs no network."""
    return _environment().get_template(f'{page}.html').render(version=__version__, **values)


def data_url(kind: str, data: bytes) -> str:
    """Return an image of the MIME type `kind` as a URL that contains it."""
    return f'data:{kind};base64,{b64encode(data).decode()}'


@cache
def _environment() -> Environment:
    return Environment(
        loader=PackageLoader('barc_sim.lab', 'pages'),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
