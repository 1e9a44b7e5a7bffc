"""Serves the live page's files and its websocket from a thread, behind a secret token."""

from __future__ import annotations

import asyncio
import logging
import socket
from http import HTTPStatus
from ipaddress import ip_address
from pathlib import Path
from secrets import compare_digest, token_urlsafe
from threading import Event, Thread
from typing import TYPE_CHECKING

from websockets.asyncio.server import ServerConnection, broadcast, serve
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request as HttpRequest
from websockets.http11 import Response

from barc_sim.cli.parser import warn
from barc_sim.errors import UserError
from barc_sim.figures.colours import style_sheet
from barc_sim.page.access import own_hosts, refusal
from barc_sim.page.opening import open_page
from barc_sim.page.protocol import RequestError, parse

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from barc_sim.page.opening import RedirectFile
    from barc_sim.page.protocol import Request

_FILES = Path(__file__).with_name('web')
_TYPES = {
    '.css': 'text/css; charset=utf-8',
    '.html': 'text/html; charset=utf-8',
    '.js': 'text/javascript; charset=utf-8',
    '.svg': 'image/svg+xml',
}
_HEADERS = {
    'Cache-Control': 'no-store',
    'Content-Security-Policy': "default-src 'none'; script-src 'self'; style-src 'self'; "
    "img-src 'self'; connect-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'",
    'Referrer-Policy': 'no-referrer',
    'X-Content-Type-Options': 'nosniff',
}
_HANDSHAKE = 2.0  #: [s] for a connection to send its token
_MAX_MESSAGE = 256  #: [byte] from a page
_MAX_UNSENT = 1 << 20  #: [byte] queued for a slow page; with more, it misses states
_PING = 5.0  #: [s]
HOUR = 3600.0  #: [s]
_POLICY_VIOLATION = 1008
_QUIET = logging.getLogger('barc_sim.page.server')
_QUIET.addHandler(logging.NullHandler())
_QUIET.propagate = False


class ViewServer:
    """Serves the page at `url`, which contains a secret token, until it is closed.

    Its thread calls `greet`, `receive`, `leave` and `pulse`. A page is its connection.

    Parameters
    ----------
    address
        The address to listen on.
    port
        The port; 0 for any free one.
    greeting
        The messages for each new page.

    Raises
    ------
    UserError
        The port cannot be used.
    """

    def __init__(
        self,
        address: str = '127.0.0.1',
        port: int = 0,
        greeting: Iterable[str | bytes] = (),
    ) -> None:
        self._greeting = greeting
        self._socket = _listen(address, port)
        bound = self._socket.getsockname()
        bound_address = bound[0]
        bound_port = bound[1]
        if not ip_address(bound_address).is_loopback:
            warn(
                'the link to the live page, with its token, is sent as plain text: in a network '
                'that you do not trust, use --view-host 127.0.0.1 and ssh -L'
            )
        self._token = token_urlsafe(16)
        self._hosts = own_hosts(address)
        name = _reachable(address)
        if ':' in name:
            name = f'[{name}]'
        self.url = f'http://{name}:{bound_port}/{self._token}/'

        self._files = {
            path.name: path.read_bytes() for path in _FILES.iterdir() if path.suffix in _TYPES
        }
        self._files['palette.css'] = style_sheet().encode()
        self.pages: set[ServerConnection] = set()  #: the open pages
        self._redirect: RedirectFile | None = None  # until a page is open

        self._loop = asyncio.new_event_loop()
        self._closing = asyncio.Event()
        self._ready = Event()
        self._thread = Thread(target=self._run_thread, name='view server', daemon=True)

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()
        self._ready.wait()

    def open_browser(self) -> None:
        """Open the page in a browser if there is a desktop, without waiting."""
        self._redirect = open_page(self.url)

    def greet(self) -> Iterable[str | bytes]:
        """Return the messages for a new page."""
        return self._greeting

    def receive(self, page: ServerConnection, request: Request) -> None:
        """Handle a request of a page."""

    def leave(self, page: ServerConnection) -> None:
        """Handle the end of a page's connection."""

    def pulse(self) -> float:
        """Do the periodic work; return the time to the next call [s]."""
        return HOUR

    def send(self, message: str | bytes) -> None:
        """Send a message to all pages without waiting; call it in the server's thread only."""
        fast_pages = [
            page for page in self.pages if page.transport.get_write_buffer_size() < _MAX_UNSENT
        ]
        broadcast(fast_pages, message)

    def call(self, callback: Callable[[], object]) -> None:
        """Call `callback` in the server's thread, unless the thread has ended."""
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(callback)

    def close(self) -> None:
        """Send the pending messages, close pages and port, and end the thread."""
        self.call(self._closing.set)
        self._thread.join()
        self._remove_redirect()

    def _remove_redirect(self) -> None:
        if self._redirect:
            self._redirect.remove()
            self._redirect = None

    def _run_thread(self) -> None:
        try:
            self._loop.run_until_complete(self._serve())
        finally:
            self._loop.close()

    async def _serve(self) -> None:
        async with serve(
            self._on_page,
            sock=self._socket,
            process_request=self._answer,
            compression=None,  # it costs time, and hardly shrinks the states
            max_size=_MAX_MESSAGE,
            ping_interval=_PING,
            ping_timeout=_PING,
            close_timeout=1.0,
            open_timeout=_HANDSHAKE,
            server_header=None,
            logger=_QUIET,
        ):
            self._ready.set()
            pulses = asyncio.create_task(self._pulse())
            closing = asyncio.create_task(self._closing.wait())
            # The pulses end only by an exception, which `result` raises.
            finished, pending = await asyncio.wait(
                [pulses, closing], return_when=asyncio.FIRST_COMPLETED
            )
            for task in pending:
                task.cancel()
            for task in finished:
                task.result()

    async def _pulse(self) -> None:
        while True:  # noqa: ASYNC110 (there is no event to wait for)
            await asyncio.sleep(self.pulse())

    def _answer(self, _connection: ServerConnection, request: HttpRequest) -> Response | None:
        """Return a file or an error as a response; None lets the websocket open."""
        reason = refusal(request.headers, self._hosts)
        if reason:
            return _refuse(HTTPStatus.FORBIDDEN, reason)

        path, _, _ = request.path.partition('?')
        token, slash, name = path[1:].partition('/')
        if not compare_digest(token.encode(errors='replace'), self._token.encode()):
            return _refuse(
                HTTPStatus.FORBIDDEN, 'Open the whole address that the run printed, token included.'
            )
        if not slash:  # the page's files are named relative to its address
            moved = _refuse(HTTPStatus.PERMANENT_REDIRECT, 'The address ends with a slash.')
            moved.headers['Location'] = f'/{self._token}/'
            return moved

        if name == 'socket':
            return None

        name = name or 'index.html'
        if name in self._files:
            return _response(HTTPStatus.OK, _TYPES[Path(name).suffix], self._files[name])
        return _refuse(HTTPStatus.NOT_FOUND, 'There is nothing here.')

    async def _on_page(self, connection: ServerConnection) -> None:
        try:
            for message in self.greet():
                broadcast([connection], message)
            self.pages.add(connection)
            self._remove_redirect()
            async for data in connection:
                self.receive(connection, parse(data))
        except RequestError as error:
            await connection.close(_POLICY_VIOLATION, f'malformed: {error}'[:100])
        except ConnectionClosed:
            pass
        finally:
            self.pages.discard(connection)
            self.leave(connection)


def _listen(address: str, port: int) -> socket.socket:
    try:
        places = socket.getaddrinfo(address, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
        family, _, _, _, where = places[0]

        return socket.create_server(where[:2], family=family)
    except OSError as error:
        raise UserError(
            f'the live page cannot be served on port {port} of {address!r} ({error.strerror}): '
            'choose another with --view-port and --view-host, or with the parameters port and '
            'host of the node view'
        ) from None


def _reachable(address: str) -> str:
    """Return `address`; for a wildcard, the address of the interface to the network."""
    if address not in ('', '0.0.0.0', '::'):  # noqa: S104 (compared, not bound)
        return address
    with socket.socket(type=socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(('192.0.2.1', 9))  # an unused address; no packet is sent
            return str(probe.getsockname()[0])
        except OSError:
            return '127.0.0.1'


def _refuse(status: HTTPStatus, text: str) -> Response:
    return _response(status, 'text/plain; charset=utf-8', f'{text}\n'.encode())


def _response(status: HTTPStatus, kind: str, body: bytes) -> Response:
    headers = {'Content-Type': kind, 'Content-Length': str(len(body)), 'Connection': 'close'}
    return Response(status.value, status.phrase, Headers(headers | _HEADERS), body)
