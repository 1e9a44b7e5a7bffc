"""A headless Chromium, spoken to in its own protocol."""

from __future__ import annotations

import base64
import json
import os
import shutil
import subprocess
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

from websockets.sync.client import connect

if TYPE_CHECKING:
    from collections.abc import Callable

    from typing_extensions import Self

CHROMIUM = shutil.which('chromium') or shutil.which('chromium-browser')
#: axe-core's script, for the tests of accessibility: `npm install axe-core` somewhere.
AXE = Path(os.environ.get('AXE_CORE', 'node_modules/axe-core')) / 'axe.min.js'
_FLAGS = (
    '--headless',
    '--no-sandbox',
    '--disable-gpu',
    '--disable-quic',
    '--disable-dev-shm-usage',
    '--no-first-run',
    '--disable-background-networking',
    '--disable-component-update',
    '--disable-sync',
    '--remote-debugging-port=0',
)
_DEADLINE = 100.0
#: Scripts that this file runs on a page.
_PROGRAMS = Path(__file__).with_name('programs')
_PICTURE = """((c) => {
  const copy = new OffscreenCanvas(c.width, c.height);
  const context = copy.getContext('2d', { willReadFrequently: true });
  context.drawImage(c, 0, 0);
  return context.getImageData(0, 0, c.width, c.height).data;
})(document.querySelector('%s'))"""
_KEYS = {
    'ArrowUp': ('ArrowUp', 38),
    'ArrowDown': ('ArrowDown', 40),
    'ArrowLeft': ('ArrowLeft', 37),
    'ArrowRight': ('ArrowRight', 39),
    'Space': (' ', 32),
    'Tab': ('Tab', 9),
    'Enter': ('Enter', 13),
    'Escape': ('Escape', 27),
    'KeyF': ('f', 70),
    'KeyR': ('r', 82),
    'KeyP': ('p', 80),
}


#: Width, height [px], and whether fingers are used.
SIZES = (
    (1440, 900, False),
    (1280, 720, False),
    (1024, 768, False),
    (768, 1024, False),
    (740, 360, True),
    (667, 375, True),
    (390, 844, True),
    (360, 760, True),
)
#: The keys that use a control of that tag or type.
_USES = {
    **dict.fromkeys(('range', 'number', 'SELECT'), ('ArrowUp', 'ArrowDown')),
    **dict.fromkeys(('BUTTON', 'SUMMARY'), ('Space',)),
    'A': ('Enter',),
}


class Browser:
    """A browser with a fresh profile, until it is closed."""

    def __enter__(self) -> Self:
        """Start it."""
        self._profile = Path(tempfile.mkdtemp(prefix='chromium-'))
        # ROS's own libraries, where it comes as wheels, are not for Chromium.
        environment = {k: v for k, v in os.environ.items() if k != 'LD_LIBRARY_PATH'}
        self._process = subprocess.Popen(
            [str(CHROMIUM), *_FLAGS, f'--user-data-dir={self._profile}', 'about:blank'],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env=environment,
        )
        address = self._profile / 'DevToolsActivePort'
        wait_until(lambda: address.exists() and address.read_text().count('\n') == 1)
        self.port, self._path = address.read_text().split('\n')
        return self

    def __exit__(self, *_: object) -> None:
        """End it, and remove its profile."""
        self._process.terminate()
        self._process.wait(_DEADLINE)
        shutil.rmtree(self._profile, ignore_errors=True)

    def open(self, url: str, width: int = 1280, height: int = 800, *, touch: bool = False) -> Tab:
        """Return a new tab that has loaded `url`."""
        with connect(f'ws://127.0.0.1:{self.port}{self._path}', proxy=None) as socket:
            # A window of its own: a tab behind another one is neither drawn nor has the focus.
            params = {'url': 'about:blank', 'newWindow': True}
            target = _ask(socket, 1, 'Target.createTarget', params, [])['targetId']
        tab = Tab(f'ws://127.0.0.1:{self.port}/devtools/page/{target}')
        tab.resize(width, height, touch=touch)
        tab.go(url)
        return tab


class Tab:
    """A page of a browser; `problems` is what its console complained of."""

    def __init__(self, address: str) -> None:
        """Attach to the page at `address`."""
        self._open = ExitStack()
        self._socket = self._open.enter_context(
            connect(address, max_size=None, compression=None, proxy=None)
        )
        self._id = 0
        self._events: list[dict[str, Any]] = []
        for domain in ('Page', 'Runtime', 'Log'):
            self.ask(f'{domain}.enable')
        self.ask('Emulation.setFocusEmulationEnabled', enabled=True)

    @property
    def problems(self) -> list[str]:
        """Errors and warnings on the console, and exceptions, so far."""
        self.run('0')  # earlier messages of the console have arrived then
        problems_so_far = []
        for event in self._events:
            method, params = event['method'], event['params']
            if method == 'Runtime.exceptionThrown':
                problems_so_far.append(str(params['exceptionDetails']))
            elif method == 'Runtime.consoleAPICalled' and params['type'] in ('error', 'warning'):
                problems_so_far.append(str(params['args']))
            elif method == 'Log.entryAdded' and params['entry']['level'] in ('error', 'warning'):
                problems_so_far.append(f'{params["entry"]["text"]} {params["entry"].get("url")}')
        return problems_so_far

    def ask(self, method: str, **params: Any) -> dict[str, Any]:  # noqa: ANN401 (the protocol's)
        """Return the browser's answer to a command."""
        self._id += 1
        return _ask(self._socket, self._id, method, params, self._events)

    def go(self, url: str) -> None:
        """Load `url`."""
        self.ask('Page.navigate', url=url)
        wait_until(lambda: self.run('document.readyState + location.href') == f'complete{url}')

    def run(self, script: str) -> Any:  # noqa: ANN401 (any value of JavaScript's)
        """Return the value of an expression, awaited."""
        answer = self.ask(
            'Runtime.evaluate', expression=script, returnByValue=True, awaitPromise=True
        )
        assert 'exceptionDetails' not in answer, answer['exceptionDetails']
        return answer['result'].get('value')

    def run_file(self, path: Path) -> Any:  # noqa: ANN401 (any value of JavaScript's)
        """Return the value of the expression in a file, awaited."""
        return self.run(path.read_text(encoding='utf-8'))

    def text(self, selector: str) -> str:
        """Return the text that an element shows."""
        return str(self.run(f'document.querySelector({selector!r}).innerText'))

    def number(self, selector: str) -> float:
        """Return the number that an element shows; NaN for a dash."""
        text = self.text(selector).replace('\N{MINUS SIGN}', '-')
        return float('nan') if text == '\N{EN DASH}' else float(text)

    def until(self, condition: str) -> None:
        """Wait until an expression is true."""
        wait_until(lambda: self.run(condition), condition)

    def click(self, selector: str) -> None:
        """Click into the middle of an element."""
        self._mouse('mousePressed', *self.middle(selector))
        self._mouse('mouseReleased', *self.middle(selector))

    def middle(self, selector: str) -> tuple[float, float]:
        """Return where an element's middle is [px]."""
        x, y = self.run(
            f'(() => {{ const e = document.querySelector({selector!r});'
            "e.scrollIntoView({ block: 'nearest' }); const b = e.getBoundingClientRect();"
            'return [b.x + b.width / 2, b.y + b.height / 2]; })()'
        )
        return x, y

    def _mouse(self, kind: str, x: float, y: float) -> None:
        self.ask('Input.dispatchMouseEvent', type=kind, x=x, y=y, button='left', clickCount=1)

    def hover(self, selector: str) -> None:
        """Move the mouse to the middle of an element."""
        x, y = self.middle(selector)
        self.ask('Input.dispatchMouseEvent', type='mouseMoved', x=x, y=y)

    def wheel(self, selector: str, by: float) -> None:
        """Turn the wheel over the middle of an element."""
        x, y = self.middle(selector)
        self.ask('Input.dispatchMouseEvent', type='mouseWheel', x=x, y=y, deltaX=0, deltaY=by)

    def select(self, selector: str, value: str | float, event: str = 'change') -> None:
        """Choose an option, or enter a value."""
        self.run(
            f'(() => {{ const s = document.querySelector({selector!r}); s.value = {value!r};'
            f's.dispatchEvent(new Event({event!r})); }})()'
        )

    def press(self, code: str) -> None:
        """Press a key and hold it."""
        self._key('rawKeyDown', code)

    def release(self, code: str) -> None:
        """Let a key go."""
        self._key('keyUp', code)

    def _key(self, kind: str, code: str) -> None:
        key, number = _KEYS[code]
        self.ask(
            'Input.dispatchKeyEvent', type=kind, code=code, key=key, windowsVirtualKeyCode=number
        )

    def type(self, code: str) -> None:
        """Press a key and release it."""
        self.press(code)
        self.release(code)

    def focus_by_tab(self, selector: str) -> None:
        """Press Tab until an element has the focus."""
        self.run('document.activeElement.blur()')
        for _ in range(60):
            self.type('Tab')
            if self.run(f'document.activeElement.matches({selector!r})'):
                return
        raise AssertionError(f'Tab does not reach {selector}')

    def enter(self, selector: str, text: str) -> None:
        """Type a text into a field in place of what it has, and press Enter."""
        self.write(selector, text)
        self.ask('Input.dispatchKeyEvent', type='keyDown', key='Enter', code='Enter', text='\r')
        self.release('Enter')

    def write(self, selector: str, text: str) -> None:
        """Type a text into a field in place of what it has; the field keeps the focus."""
        self.run(
            f'(() => {{ const e = document.querySelector({selector!r});e.focus(); e.select(); }})()'
        )
        if text:
            self.ask('Input.insertText', text=text)
        else:
            self.ask(
                'Input.dispatchKeyEvent',
                type='keyDown',
                key='Backspace',
                code='Backspace',
                windowsVirtualKeyCode=8,
            )

    def drag(self, selector: str, by: float) -> None:
        """Press the mouse on an element's middle, move it to the right [px], and release it."""
        x, y = self.middle(selector)
        self._mouse('mousePressed', x, y)
        for share in (0.5, 1.0):
            self._mouse('mouseMoved', x + share * by, y)
        self._mouse('mouseReleased', x + by, y)

    def touch(self, kind: str, *points: tuple[float, float], at: float | None = None) -> None:
        """Put fingers on the screen ('touchStart'), move or lift them ('touchEnd'), `at` [s]."""
        time = {} if at is None else {'timestamp': at}
        fingers = [{'x': x, 'y': y, 'id': k} for k, (x, y) in enumerate(points)]
        self.ask('Input.dispatchTouchEvent', type=kind, touchPoints=fingers, **time)

    def without_keyboard(self) -> list[str]:
        """Return the controls that Tab does not reach, that show no focus, or that no key uses.

        Nothing that a key does has an effect.
        """
        count = self.run_file(_PROGRAMS / 'controls.js')
        for _ in range(count + 2):  # the page itself can have the focus between last and first
            self.type('Tab')
            for key in _USES.get(self.run('focused()'), ()):
                self.type(key)
        return list(self.run('unused()'))

    def cut_labels(self) -> list[str]:
        """Return the texts that are drawn across the border of a canvas in a moment."""
        return list(self.run_file(_PROGRAMS / 'cut_labels.js'))

    def overflow(self) -> list[str]:
        """Return what is wider than the page, leaves its panel or is cut, by name."""
        return list(self.run_file(_PROGRAMS / 'overflow.js'))

    def remember(self, canvas: str) -> None:
        """Remember a canvas's picture, for `changed`, once it has a size."""
        self.until(f'document.querySelector({canvas!r}).width > 1')
        self.run(f'(window.kept ??= {{}}, kept[{canvas!r}] = {_PICTURE % canvas}, 0)')

    def changed(self, canvas: str) -> int:
        """Return how many values of a canvas's pixels are not those remembered."""
        return int(
            self.run(f'{_PICTURE % canvas}.reduce((n, v, i) => n + (v !== kept[{canvas!r}][i]), 0)')
        )

    def resize(self, width: int, height: int, *, touch: bool = False) -> None:
        """Give the page that size [px], and fingers in place of a mouse."""
        self.ask(
            'Emulation.setDeviceMetricsOverride',
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=touch,
        )
        self.ask('Emulation.setTouchEmulationEnabled', enabled=touch)

    def dark(self, *, on: bool) -> None:
        """Prefer dark colours, or light ones."""
        self.media(prefers_color_scheme='dark' if on else 'light')

    def media(self, kind: str = '', **features: str) -> None:
        """Set features of the medium, such as `forced_colors='active'`, and its kind ('print')."""
        settings = [{'name': k.replace('_', '-'), 'value': v} for k, v in features.items()]
        self.ask('Emulation.setEmulatedMedia', media=kind, features=settings)

    def violations(self, axe: Path) -> list[str]:
        """Return what the checker axe-core, in the file `axe`, finds wrong on the page."""
        self.run(axe.read_text(encoding='utf-8') + '; 0')
        return list(
            self.run(
                'axe.run().then((r) => r.violations.map((v) =>'
                "`${v.id}: ${v.nodes.map((n) => n.target.join(' ')).join(', ')}`))"
            )
        )

    def screenshot(self, path: Path, *, whole: bool = False) -> None:
        """Save what is seen, or the whole page, as a PNG."""
        answer = self.ask('Page.captureScreenshot', format='png', captureBeyondViewport=whole)
        path.write_bytes(base64.b64decode(answer['data']))

    def close(self) -> None:
        """Close the page."""
        self.ask('Page.close')
        self._open.close()


def _ask(
    socket: Any,  # noqa: ANN401 (a websocket)
    number: int,
    method: str,
    params: dict[str, Any],
    events: list[dict[str, Any]],
) -> dict[str, Any]:
    socket.send(json.dumps({'id': number, 'method': method, 'params': params}))
    while True:
        message = json.loads(socket.recv(timeout=_DEADLINE))
        if message.get('id') == number:
            assert 'error' not in message, message['error']
            return dict(message['result'])
        events.append(message)


def wait_until(condition: Callable[[], object], what: str = 'the condition') -> None:
    """Wait until `condition` returns something true; fail after half a minute."""
    end = time.monotonic() + _DEADLINE
    while not condition():
        assert time.monotonic() < end, f'{what} did not come true within {_DEADLINE} s'
        time.sleep(0.02)
