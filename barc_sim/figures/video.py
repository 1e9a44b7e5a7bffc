"""Writes images as a video file, with Python packages alone."""

from __future__ import annotations

from contextlib import closing
from itertools import chain
from typing import TYPE_CHECKING

import imageio_ffmpeg
from PIL import Image

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from pathlib import Path

    import numpy as np
    from numpy.typing import NDArray

    Images = Iterable[NDArray[np.uint8]]

# The index comes first, so that a browser plays the file while it loads. The colours are HDTV's,
# as the file states: players would guess. The encoder takes half as long as with the preset
# `veryfast`, and less than the drawing, which goes on beside it; the file is 1.7 times as large.
ENCODING = {
    '-crf': '20',
    '-preset': 'superfast',
    '-tune': 'zerolatency',
    '-vf': 'scale=out_color_matrix=bt709:out_range=tv',
    '-colorspace': 'bt709',
    '-movflags': '+faststart',
}


def write_mp4(path: Path, images: Images, *, size: tuple[int, int], fps: int) -> None:
    """Write RGBA images of shape `(height, width, 4)` as H.264 in 4:2:0, which all players support.

    `size` is `(width, height)`, both even.
    """
    writer = imageio_ffmpeg.write_frames(
        path,
        size,
        pix_fmt_in='rgba',
        pix_fmt_out='yuv420p',
        fps=fps,
        codec='libx264',
        quality=None,
        macro_block_size=2,
        ffmpeg_log_level='error',
        output_params=[*chain(*ENCODING.items())],
    )
    with closing(writer):
        writer.send(None)
        for image in images:
            writer.send(image)


def write_gif(path: Path, images: Images, *, fps: int) -> None:
    """Write RGBA images of shape `(height, width, 4)`, at least one, as a GIF that repeats.

    A GIF's unit of time is 10 ms, so `fps` should divide 100.
    """
    stills = _one_palette(images)
    next(stills).save(
        path, save_all=True, append_images=stills, duration=1000 // fps, loop=0, optimize=False
    )


def _one_palette(images: Images) -> Iterator[Image.Image]:
    """Give every image the first one's colours: no flicker, and a small file."""
    palette = None
    for image in images:
        colours = Image.fromarray(image).convert('RGB')
        palette = palette or colours.quantize(256, dither=Image.Dither.NONE)
        yield colours.quantize(palette=palette, dither=Image.Dither.NONE)
