"""Decides which requests the live page's server answers, by their headers Host and Origin.

Another site's page in the user's browser can send requests to this machine: by a name of its own
that it lets point here (DNS rebinding), or from its own origin. Such a name is never an IP address.
"""

from __future__ import annotations

import socket
from contextlib import suppress
from ipaddress import ip_address
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

if TYPE_CHECKING:
    from collections.abc import Collection

    from websockets.datastructures import Headers

_WRONG_HOST = (
    'This host name is not one of the run: open the address that the run printed, or give the '
    'name to the run with --view-host.'
)
_WRONG_ORIGIN = 'A page of another site asks for this: open the address that the run printed.'


def own_hosts(address: str) -> set[str]:
    """Return the names by which a page served at `address` can be opened."""
    machine = socket.gethostname().lower()
    short, _, _ = machine.partition('.')
    return {address.lower(), machine, short, f'{short}.local'}


def refusal(headers: Headers, hosts: Collection[str]) -> str:
    """Return why a request with these headers is refused; '' if it is answered.

    Its Host must be an IP address, localhost or one of `hosts`, with any port: a tunnel may have
    another one. Its Origin, if it has one, must be the page itself. Programs send none.
    """
    hosts_sent = headers.get_all('Host')
    host = hosts_sent[0].lower() if len(hosts_sent) == 1 else ''
    if not _is_own(_name_of(host), hosts):
        return _WRONG_HOST
    if any(_host_of(origin) != host for origin in headers.get_all('Origin')):
        return _WRONG_ORIGIN
    return ''


def _is_own(name: str, hosts: Collection[str]) -> bool:
    if not name:
        return False
    if name in hosts or name == 'localhost' or name.endswith('.localhost'):
        return True
    with suppress(ValueError):
        ip_address(name)
        return True
    return False


def _name_of(host: str) -> str:
    """Return the name or IP address in a header Host; '' if it is malformed."""
    try:
        parts = urlsplit(f'//{host}')
        _ = parts.port  # a ValueError, if it is none
    except ValueError:
        return ''

    has_other_parts = parts.netloc != host or '@' in host
    if has_other_parts:
        return ''
    return parts.hostname or ''


def _host_of(origin: str) -> str:
    """Return the host and port of a header Origin; '' if it is none of a web page."""
    scheme, _, host = origin.lower().partition('://')
    return host if scheme in ('http', 'https') else ''
