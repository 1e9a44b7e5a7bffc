"""A view in motion: which times it shows, and what each frame holds."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from barc_sim.figures import output
from barc_sim.figures.side_view import SideView
from barc_sim.simulation.closed_loop import closed_loop

if TYPE_CHECKING:
    from collections.abc import Iterator


@pytest.fixture
def view() -> SideView:
    return SideView(closed_loop(distance=30.0), Figure(figsize=(6.4, 3.6), dpi=50))


@pytest.mark.parametrize('fps', [25, 50])
def test_a_film_shows_first_and_last_state_and_lasts_as_long_as_the_run(fps: int) -> None:
    times = output.frame_times(23.02, fps)
    assert times[0] == 0.0
    assert times[-1] == 23.02
    assert len(times) / fps == pytest.approx(23.02 + 1 / fps, abs=1 / fps)
    assert np.diff(times)[:-1] == pytest.approx(1 / fps)


def test_a_film_of_one_state_has_one_frame() -> None:
    assert output.frame_times(0.0, 50).tolist() == [0.0]


def test_a_frame_is_what_drawing_everything_anew_gives(view: SideView) -> None:
    quick = [image.copy() for image in output.frames(view, [0.0, 3.3, 1.0])]
    for artist in view.artists:
        artist.set_animated(False)
    canvas = FigureCanvasAgg(view.figure)
    for image, t in zip(quick, [0.0, 3.3, 1.0], strict=True):
        view.update(t)
        canvas.draw()
        assert np.array_equal(image, np.asarray(canvas.buffer_rgba()))
    assert not np.array_equal(quick[0], quick[1])


def test_a_window_plays_by_the_clock_and_ends_with_the_last_state(
    view: SideView, monkeypatch: pytest.MonkeyPatch
) -> None:
    ticks: Iterator[float] = iter([100.0, 100.0, 100.5, 103.0, 1e6])
    monkeypatch.setattr(output, 'monotonic', lambda: next(ticks))
    canvas = FigureCanvasAgg(view.figure)
    playing = output.animate(view)
    canvas.draw()  # starts it
    assert list(playing.new_frame_seq()) == [0.0, 0.5, 3.0, view.duration]
