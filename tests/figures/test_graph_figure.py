"""The graph of nodes and topics: who is where, and where arrows lead."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Text

from barc_sim.bags.bounds import MAX_NAME
from barc_sim.bags.graph import NodeGraph
from barc_sim.figures.colours import BLUE, MUTED
from barc_sim.figures.graph_figure import graph_figure, save

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.figure import Figure

LOOP = NodeGraph(
    ('/pid', '/recorder', '/sim'),
    dict.fromkeys(('/clock', '/ecu', '/reference', '/state', '/rosout'), ''),
    (('/pid', '/ecu'), *(('/sim', topic) for topic in ('/clock', '/state', '/rosout'))),
    (
        *(('/ecu', node) for node in ('/recorder', '/sim')),
        *(('/state', node) for node in ('/pid', '/recorder')),
        ('/clock', '/recorder'),
        ('/reference', '/pid'),
    ),
)


def places(figure: Figure) -> dict[str, tuple[float, float]]:
    return {text.get_text(): text.get_position() for text in figure.axes[0].findobj(Text)}


def arrows(figure: Figure) -> set[tuple[float, float, float]]:
    """Return the height of each arrow, where it begins and where it ends."""
    lines = [line for line in figure.axes[0].lines if line.get_color() in (MUTED, BLUE)]
    arrows_in_figure = set()
    for shafts, heads in zip(lines[::2], lines[1::2], strict=True):
        x, y = shafts.get_data()
        assert [*heads.get_xdata()] == pytest.approx(x[1::3], abs=0.1)
        arrows_in_figure |= {*zip(y[::3].tolist(), x[::3].tolist(), x[1::3].tolist(), strict=True)}
    return arrows_in_figure


def test_arrows_lead_from_publishers_to_subscribers_in_the_row_of_their_topic() -> None:
    figure = graph_figure(LOOP, 'mine')
    at, arrows_drawn = places(figure), arrows(figure)
    x = {node: at[node][0] for node in LOOP.nodes}
    assert x['/sim'] < x['/pid'] < x['/recorder']

    clock, ecu, state, reference = (
        at[topic][1] for topic in ('/clock', '/ecu', '/state', '/reference')
    )
    from_outside = {each for each in arrows_drawn if each[0] == reference}
    assert arrows_drawn - from_outside == {
        (clock, x['/sim'], x['/recorder']),
        (state, x['/sim'], x['/pid']),
        (state, x['/sim'], x['/recorder']),
        (ecu, x['/pid'], x['/sim']),
        (ecu, x['/pid'], x['/recorder']),
    }

    ((_, begin, end),) = from_outside
    assert begin < x['/sim'] < end == x['/pid']
    assert '/rosout' not in at


def test_a_node_that_subscribes_to_its_own_topic_has_an_arrow() -> None:
    figure = graph_figure(NodeGraph(('/a',), {'/t': ''}, (('/a', '/t'),), (('/t', '/a'),)))
    ((_, begin, end),) = arrows(figure)
    assert begin < end == places(figure)['/a'][0]


def test_no_words_overlap_or_leave_the_figure() -> None:
    figure = graph_figure(LOOP, 'mine')
    FigureCanvasAgg(figure).draw()
    boxes = [text.get_window_extent() for text in figure.axes[0].findobj(Text) if text.get_text()]
    assert all(figure.bbox.contains(*corner) for box in boxes for corner in (box.min, box.max))
    assert not any(left.overlaps(other) for left, other in pairwise(boxes))


def test_names_of_any_length_make_a_picture(tmp_path: Path) -> None:
    names = [f'/{k}'.ljust(MAX_NAME, 'x') for k in range(20)]
    nodes, topics = names[::2], names[1::2]
    links = [(topic, node) for topic in topics for node in nodes]
    back = tuple(link[::-1] for link in links)
    graph = NodeGraph((*nodes,), dict.fromkeys(topics, ''), back, (*links,))
    save(graph_figure(graph), tmp_path / 'graph.png')
