"""The live page's server: access, messages and its end."""

from __future__ import annotations

import http.client
import json
import os
import re
import shlex
import socket
import subprocess
import sys
import tempfile
import webbrowser
from contextlib import ExitStack, closing, suppress
from pathlib import Path
from threading import Event
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

import pytest
from command_line import wait_for
from websockets.asyncio.server import broadcast
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from barc_sim.control.driver import DriverInput
from barc_sim.errors import UserError
from barc_sim.page.protocol import encode
from barc_sim.page.server import ViewServer

if TYPE_CHECKING:
    from collections.abc import Iterator

    from websockets.asyncio.server import ServerConnection

    from barc_sim.page.protocol import Request

DEADLINE = 100.0
PROGRAMS = Path(__file__).with_name('programs')


class Recorder(ViewServer):
    """Records what happens."""

    def __init__(self, address: str = '127.0.0.1') -> None:
        super().__init__(address, greeting=[encode('hello'), b'history'])
        self.received: list[Request] = []
        self.left = 0

    def receive(self, page: ServerConnection, request: Request) -> None:
        """Record the request, and answer."""
        self.received.append(request)
        broadcast([page], encode('refused', what='drive', why='test'))

    def leave(self, page: ServerConnection) -> None:  # noqa: ARG002 (the server's)
        """Count the page."""
        self.left += 1

    def pulse(self) -> float:
        """Do nothing."""
        return 0.01


@pytest.fixture
def server() -> Iterator[Recorder]:
    server = Recorder()
    server.start()
    yield server
    server.close()


def page(server: ViewServer, **options: Any) -> Any:  # noqa: ANN401 (websockets' own)
    options = {'open_timeout': DEADLINE, 'proxy': None, **options}
    return connect(server.url.replace('http', 'ws') + 'socket', **options)


def end_of(client: Any) -> Any:  # noqa: ANN401 (websockets' own)
    """Return the close frame of the server, after skipping all messages."""
    with suppress(ConnectionClosed):
        while True:
            client.recv(DEADLINE)
    return client.protocol.close_rcvd


def get(server: ViewServer, path: str) -> tuple[int, dict[str, str], bytes]:
    client = http.client.HTTPConnection(urlsplit(server.url).netloc, timeout=DEADLINE)
    try:
        client.request('GET', path)
        response = client.getresponse()
        return response.status, dict(response.getheaders()), response.read()
    finally:
        client.close()


def token(server: ViewServer) -> str:
    return urlsplit(server.url).path.strip('/')


def test_page_is_served_on_this_machine_with_a_strict_content_policy(server: ViewServer) -> None:
    assert urlsplit(server.url).hostname == '127.0.0.1'
    status, headers, body = get(server, f'/{token(server)}/')
    assert status == 200
    assert headers['Content-Type'].startswith('text/html')
    assert "default-src 'none'" in headers['Content-Security-Policy']
    assert headers['X-Content-Type-Options'] == 'nosniff'
    assert body.startswith(b'<!DOCTYPE html>')


def test_the_server_starts_without_importing_matplotlib() -> None:
    program = 'import sys, barc_sim.page.run_page; print("matplotlib" in sys.modules)'
    process = subprocess.run([sys.executable, '-c', program], capture_output=True, check=True)
    assert process.stdout.strip() == b'False'


@pytest.mark.parametrize(
    ('path', 'status'),
    [
        ('/', 403),
        ('/main.js', 403),
        ('/wrong/', 403),
        ('/{token}x/', 403),
        ('/%ff/', 403),
        ('/{token}', 308),
        ('/{token}/nothing.js', 404),
        ('/{token}/../view_server.py', 404),
        ('/{token}/..%2fview_server.py', 404),
    ],
)
def test_only_files_of_the_page_are_served_and_only_with_the_token(
    server: ViewServer, path: str, status: int
) -> None:
    path = path.format(token=token(server))
    with socket.create_connection(('127.0.0.1', urlsplit(server.url).port), DEADLINE) as client:
        client.sendall(f'GET {path} HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n'.encode())
        answer = client.makefile('rb').read()
    assert answer.startswith(b'HTTP/1.1 %d ' % status)


#: Headers of a request, where `{port}` is the server's, and whether it is answered.
ORIGINS: list[tuple[list[str], bool]] = [
    (['Host: 127.0.0.1:{port}'], True),
    (['Host: 127.0.0.1:{port}', 'Origin: http://127.0.0.1:{port}'], True),
    (['Host: localhost:9000', 'Origin: http://localhost:9000'], True),  # through a tunnel
    (['Host: [::1]:9000', 'Origin: http://[::1]:9000'], True),
    (['Host: 192.0.2.7', 'Origin: http://192.0.2.7'], True),
    (['Host: LocalHost:9000', 'Origin: http://localhost:9000'], True),
    (['Host: evil.example:{port}'], False),  # a name that its owner lets point here
    (['Host: evil.example:{port}', 'Origin: http://evil.example:{port}'], False),
    (['Host: 127.0.0.1.evil.example'], False),
    (['Host: localhost.evil.example'], False),
    (['Host: evil@127.0.0.1:{port}'], False),
    (['Host: 127.0.0.1:x'], False),
    (['Host: '], False),
    ([], False),
    (['Host: 127.0.0.1:{port}', 'Host: evil.example'], False),
    (['Host: 127.0.0.1:{port}', 'Origin: http://evil.example'], False),
    (['Host: 127.0.0.1:{port}', 'Origin: http://127.0.0.1:1'], False),  # another program here
    (['Host: 127.0.0.1:{port}', 'Origin: null'], False),  # a file, or a sandbox
    (['Host: 127.0.0.1:{port}', 'Origin: http://127.0.0.1:{port}', 'Origin: null'], False),
]
_UPGRADE = [
    'Upgrade: websocket',
    'Connection: Upgrade',
    'Sec-WebSocket-Version: 13',
    'Sec-WebSocket-Key: MDEyMzQ1Njc4OWFiY2RlZg==',
]


def answer_to(server: ViewServer, path: str, headers: list[str]) -> bytes:
    """Return the first line of the answer to a request with these headers and no other."""
    port = urlsplit(server.url).port or 0
    lines = [f'GET /{token(server)}/{path} HTTP/1.1', *headers, '', '']
    with socket.create_connection(('127.0.0.1', port), DEADLINE) as client:
        client.sendall('\r\n'.join(lines).format(port=port).encode())
        return client.makefile('rb').readline()


@pytest.mark.parametrize(('headers', 'is_answered'), ORIGINS)
def test_a_request_from_another_site_is_refused(
    server: ViewServer, headers: list[str], is_answered: bool
) -> None:
    page_status = b'200' if is_answered else b'403'
    assert answer_to(server, '', headers).split()[1] == page_status
    socket_status = b'101' if is_answered else b'403'
    assert answer_to(server, 'socket', [*headers, *_UPGRADE]).split()[1] == socket_status


def test_every_name_of_the_machine_is_accepted_as_host(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(socket, 'gethostname', lambda: 'Lab3.uni.example')
    server = Recorder('localhost')
    server.start()
    with closing(server):
        for name in ('localhost', 'lab3.uni.example', 'lab3', 'lab3.local'):
            assert b' 200 ' in answer_to(server, '', [f'Host: {name}:80'])
        assert b' 403 ' in answer_to(server, '', ['Host: uni.example'])


@pytest.fixture
def browser_stub(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Put a browser on PATH; return the file with what it has seen."""
    program = tmp_path / 'stub-browser'
    # A line `#!` could not hold a path with a space.
    words = shlex.join([sys.executable, str(PROGRAMS / 'stub_browser.py')])
    program.write_text(f'#!/bin/sh\nexec {words} "$@"\n')
    program.chmod(0o755)
    facts = tmp_path / 'seen.json'
    home = tmp_path / 'my home'
    home.mkdir()
    for name in ('SSH_CONNECTION', 'BARC_SIM_NO_BROWSER', 'WSL_DISTRO_NAME'):
        monkeypatch.delenv(name, raising=False)
    for name, value in (
        ('PATH', f'{tmp_path}:{os.environ["PATH"]}'),
        ('BROWSER', program.name),
        ('DISPLAY', ':0'),
        ('HOME', str(home)),
        ('SEEN', str(facts)),
    ):
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(webbrowser, '_tryorder', None)  # reads BROWSER again
    return facts


@pytest.mark.parametrize('page_opens', [True, False])
def test_the_browsers_arguments_have_no_token_and_its_file_is_private_and_removed(
    server: Recorder, browser_stub: Path, page_opens: bool
) -> None:
    server.open_browser()
    wait_for(browser_stub.exists)
    facts = json.loads(browser_stub.read_text('utf-8'))
    assert token(server) not in ' '.join(facts['arguments'])
    assert facts['modes'] == ['0o600', '0o700']

    (link,) = re.findall(r'href="(.*?)"', facts['text'])
    assert link == server.url
    assert f'content="0; url={link}"' in facts['text']

    folder = Path(facts['path']).parent
    assert not folder.name.startswith('.')  # which a browser in a container could not read

    if page_opens:
        with page(server):
            wait_for(lambda: not folder.exists())
    server.close()
    assert not folder.exists()


def test_without_a_home_directory_the_file_is_in_the_temporary_one(
    server: Recorder, browser_stub: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv('HOME', str(tmp_path / 'missing'))
    monkeypatch.setattr(tempfile, 'tempdir', str(tmp_path))
    server.open_browser()
    wait_for(browser_stub.exists)
    assert Path(json.loads(browser_stub.read_text('utf-8'))['path']).parents[1] == tmp_path


def test_a_browser_of_windows_receives_the_address_itself(
    server: Recorder, browser_stub: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It cannot open a file of Linux; the machine is its user's own."""
    opened: list[str] = []
    monkeypatch.setenv('WSL_DISTRO_NAME', 'Ubuntu')
    monkeypatch.setattr(webbrowser, 'open', opened.append)
    server.open_browser()
    wait_for(lambda: opened)
    assert opened == [server.url]
    assert not browser_stub.exists()


def test_a_page_is_greeted_and_exchanges_messages_with_the_server(server: Recorder) -> None:
    with page(server) as one, page(server) as two:
        for client in (one, two):
            assert [client.recv(DEADLINE) for _ in range(2)] == [encode('hello'), b'history']
        wait_for(lambda: len(server.pages) == 2)
        server.call(lambda: server.send(b'rows'))
        assert [client.recv(DEADLINE) for client in (one, two)] == [b'rows', b'rows']
        one.send(encode('drive', forward=0.5, turn=-1, brake=0))
        assert one.recv(DEADLINE) == encode('refused', what='drive', why='test')

    assert server.received == [DriverInput(0.5, -1.0)]


def test_every_end_of_a_page_is_noticed(server: Recorder) -> None:
    with page(server):
        pass
    wait_for(lambda: server.left == 1)
    with page(server) as client:
        client.socket.shutdown(socket.SHUT_RDWR)
        wait_for(lambda: server.left == 2)
    assert not server.pages


@pytest.mark.parametrize('message', ['{"type":"drive","forward":2}', b'\0', 'x' * 300])
def test_malformed_message_closes_the_connection(server: Recorder, message: str | bytes) -> None:
    with page(server) as client:
        client.send(message)
        assert end_of(client).code in (1008, 1009)
    assert server.received == []


def test_slow_page_misses_states_but_no_messages(server: ViewServer) -> None:
    with page(server, max_queue=1) as client:
        wait_for(lambda: server.pages)
        for _ in range(200):
            server.call(lambda: server.send(bytes(100_000)))
        is_sent = Event()
        server.call(lambda: broadcast(server.pages, encode('end', reason='test')))
        server.call(is_sent.set)
        assert is_sent.wait(DEADLINE)

        states = 0
        while (message := client.recv(DEADLINE)) != encode('end', reason='test'):
            states += isinstance(message, bytes)

    assert states < 200


def test_close_sends_the_last_message_and_frees_the_port(server: ViewServer) -> None:
    with page(server) as client:
        wait_for(lambda: server.pages)
        server.call(lambda: server.send(encode('end', reason='done')))

        server.close()
        assert [client.recv(DEADLINE) for _ in range(3)][-1] == encode('end', reason='done')
        assert end_of(client).code == 1001

    with socket.create_server(('127.0.0.1', urlsplit(server.url).port or 0)):
        pass

    server.call(lambda: pytest.fail('called'))
    server.close()


def test_the_error_names_an_address_that_cannot_be_used() -> None:
    with socket.create_server(('127.0.0.1', 0)) as other_server:
        port = other_server.getsockname()[1]
        with pytest.raises(UserError, match=f'on port {port} of .127.0.0.1.*--view-port'):
            ViewServer(port=port)
    with pytest.raises(UserError, match=r"of '192\.0\.2\.7'.*--view-host"):
        ViewServer('192.0.2.7')


def test_beyond_this_machine_the_address_can_be_opened_and_its_plain_text_is_warned_of(
    capsys: pytest.CaptureFixture[str],
) -> None:
    for address, warnings in (('127.0.0.1', 0), ('0.0.0.0', 1)):  # noqa: S104 (as for a phone)
        server = ViewServer(address)
        server.start()
        try:
            assert urlsplit(server.url).hostname != '0.0.0.0'  # noqa: S104 (compared)
            assert get(server, f'/{token(server)}/')[0] == 200
        finally:
            server.close()
        assert capsys.readouterr().err.count('plain text') == warnings


def test_connections_that_show_no_token_are_closed_and_keep_no_page_away(
    server: ViewServer,
) -> None:
    with ExitStack() as stack:
        where = ('127.0.0.1', urlsplit(server.url).port or 0)
        silent = [
            stack.enter_context(socket.create_connection(where, DEADLINE)) for _ in range(200)
        ]

        with page(server) as opened:
            assert opened.recv(DEADLINE) == encode('hello')

        for connection in silent:
            with suppress(ConnectionResetError):
                while connection.recv(1024):
                    pass
