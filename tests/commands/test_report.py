"""The command `barc report`: a run as one HTML page."""

from __future__ import annotations

import re
from base64 import b64decode
from html.parser import HTMLParser
from itertools import pairwise
from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from command_line import printed, refused
from hand_drive import drive_by_hand
from made_bags import GRAPH, make

from barc_sim.__main__ import main as barc
from barc_sim.control.driver import DriverInput
from barc_sim.control.lane import Stanley
from barc_sim.simulation.closed_loop import closed_loop, lap

if TYPE_CHECKING:
    from pathlib import Path

EVIL = '<script>alert(1)</script> $name & "quoted"'
VOID = {'meta', 'img', 'br', 'link', 'hr'}


class Page(HTMLParser):
    """Collects what a page has, and checks that what opens is closed."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.headings: list[str] = []
        self.images: list[dict[str, str | None]] = []
        self.tags: set[str] = set()
        self.text = ''
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Take an element."""
        self.tags.add(tag)
        if tag == 'img':
            self.images.append(dict(attrs))
        if re.fullmatch(r'h\d', tag):
            self.headings.append(tag)
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        """Close the innermost."""
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        """Take text."""
        self.text += data


def page_of(bag: Path) -> Page:
    assert barc(['report', str(bag)]) == 0
    page = Page((bag / 'report.html').read_text(encoding='utf-8'))
    assert not page.open
    return page


def test_a_report_is_one_page_that_needs_no_other_file(tmp_path: Path) -> None:
    bag = make(tmp_path / 'bag', closed_loop(), {'kp': '30.0', 'barc_sim': '0.1.0', 'road': 'lab'})
    page = page_of(bag)
    for words in ('Run bag', 'Gain kp', '30.0', 'after the first 10 m', '0.0207'):
        assert words in page.text
    assert not page.tags & {'script', 'link', 'iframe'}

    text = (bag / 'report.html').read_text(encoding='utf-8')
    assert not re.search(r'(src|href)="(?!data:)', text)
    # Headings go down one by one.
    assert page.headings[0] == 'h1'
    assert page.headings.count('h1') == 1
    assert all(int(b[1]) <= int(a[1]) + 1 for a, b in pairwise(page.headings))


def test_every_figure_is_whole_and_described(tmp_path: Path) -> None:
    page = page_of(make(tmp_path / 'bag', closed_loop()))
    assert len(page.images) == 3  # speed, terms, graph
    for image in page.images:
        assert image['alt']
        kind, _, data = (image['src'] or '').partition(',')
        assert kind == 'data:image/svg+xml;base64'
        assert ET.fromstring(b64decode(data)).tag.endswith('svg')
    assert '/controller publishes /ecu' in (page.images[-1]['alt'] or '')


def test_the_users_code_is_shown_line_by_line(tmp_path: Path) -> None:
    code = '"""Two\nlines."""\n\nx = 1 < 2\n'
    bag = make(
        tmp_path / 'bag', closed_loop(distance=5.0), attachments={'student/a.py': code.encode()}
    )
    page = page_of(bag)
    assert code in page.text
    assert (bag / 'report.html').read_text().count('<span class="line">') == 4


def test_texts_from_others_are_escaped(tmp_path: Path) -> None:
    keys = ('command', 'kp', 'platform', 'failure', 'road')
    bag = make(
        tmp_path / EVIL.replace('/', '').replace('"', ''),
        closed_loop(distance=5.0),
        dict.fromkeys(keys, EVIL) | {'graph': GRAPH.replace('/ecu', '/$e^{<b>$')},
        {f'student/{EVIL}.py': EVIL.encode()},
    )
    page = page_of(bag)

    assert 'script' not in page.tags
    assert page.text.count(EVIL) >= len(keys) + 2


def test_the_report_of_a_drive_by_hand_has_its_path_and_no_error(tmp_path: Path) -> None:
    page = page_of(
        make(tmp_path / 'bag', drive_by_hand([(0.0, DriverInput(forward=1.0, turn=0.3))], 3.0))
    )

    assert 'Path, heading, speed and steering' in page.text
    assert 'position along the road' not in ' '.join(str(image['alt']) for image in page.images)
    assert '/vehicle_simulator' in page.text
    assert '/vehicle_simulator publishes /z_vhcl' in str(page.images[-1]['alt'])
    assert 'Speed error' not in page.text
    assert "The controller's terms" not in page.text


def test_a_drive_straight_on_by_hand_has_speed_and_command_over_time(tmp_path: Path) -> None:
    drive = drive_by_hand([(0.0, DriverInput(forward=1.0))], 3.0)
    page = page_of(make(tmp_path / 'bag', drive))
    assert 'Speed and command' in page.text
    assert 'over time' in str(page.images[0]['alt'])
    assert 'path' not in str(page.images[0]['alt'])


def test_laps_of_a_track_name_it_and_the_steering_law(tmp_path: Path) -> None:
    info = {'track': 'circle', 'lane': 'stanley'}
    page = page_of(make(tmp_path / 'bag', lap(Stanley(), 'circle', laps=1), info))
    assert re.search(r'Track\s*circle\s*Steering law\s*stanley', page.text)
    assert 'Laps of the track' in page.text


@pytest.mark.parametrize('graph', ['[]', '{"nodes": 1}'])
def test_an_invalid_graph_is_left_out(tmp_path: Path, graph: str) -> None:
    bag = make(tmp_path / 'bag', closed_loop(distance=1.0), {'graph': graph})
    assert 'The graph was not recorded.' in page_of(bag).text


def test_numbers_that_no_run_reaches_are_left_out(tmp_path: Path) -> None:
    log = closed_loop(distance=5.0)
    log.motor[3], log.v_x[4], log.theta_deg[5] = np.inf, 1e300, np.nan
    page_of(make(tmp_path / 'bag', log))


def test_the_page_is_written_to_the_requested_path(tmp_path: Path) -> None:
    bag, path = make(tmp_path / 'bag', closed_loop(distance=1.0)), tmp_path / 'page.html'
    assert printed('report', str(bag), '-o', str(path)) == f'{path}\n'
    assert path.is_file()
    assert not (bag / 'report.html').exists()


@pytest.mark.parametrize(
    ('arguments', 'words'),
    [
        (['{none}'], 'there is no bag'),
        (['{bag}', '-o', 'page.pdf'], 'the name must end in .html'),
        (['{bag}', '-o', '{none}/page.html'], 'choose another place with --save'),
        (['{bag}', '--namespace', 'car7'], 'has no states of the car /car7'),
    ],
)
def test_report_refuses_a_mistake_in_a_sentence(
    tmp_path: Path, arguments: list[str], words: str
) -> None:
    places = {'bag': make(tmp_path / 'bag', closed_loop(distance=1.0)), 'none': tmp_path / 'none'}
    assert words in refused('report', *(argument.format(**places) for argument in arguments))
