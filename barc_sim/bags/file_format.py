"""How an MCAP file stores its messages: the presets of rosbag2, and the compression of chunks."""

from __future__ import annotations

from dataclasses import dataclass

_MEBIBYTE = 2**20
_ZSTD_FASTEST = -5
_ZSTD_SLOWEST = 19

#: How the chunks of a file can be compressed.
COMPRESSION_FORMATS = ('zstd', 'lz4', 'none')


@dataclass(frozen=True, kw_only=True)
class FileFormat:
    """How a file stores its messages."""

    #: The compression of chunks: `zstd`, `lz4` or none, which is empty.
    compression: str = 'zstd'
    level: int = 3  #: of zstd
    #: [B] The maximum size of a chunk before its compression, as in rosbag2. A file's summary, in
    #: memory until the file is closed, needs about 140 bytes for each chunk. zstd reduces a chunk
    #: to 40 %, in 0.6 us a message.
    chunk_size: int = 768 * 1024
    has_chunks: bool = True  #: without chunks, there is no index of the messages
    has_chunk_checksums: bool = True
    has_checksums: bool = True  #: of all data, and of the summary


#: rosbag2's settings for a file, by name, with the levels of MCAP's library in C++. A file by
#: `none` is as rosbag2's plugin makes it by default.
_PRESETS = {
    'none': FileFormat(compression='', has_chunk_checksums=False),
    'fastwrite': FileFormat(compression='', has_chunks=False, has_checksums=False),
    'zstd_fast': FileFormat(level=_ZSTD_FASTEST, has_chunk_checksums=False),
    'zstd_small': FileFormat(level=_ZSTD_SLOWEST, chunk_size=4 * _MEBIBYTE),
}
#: The names of rosbag2's settings; the empty one chooses none of them.
STORAGE_PRESETS = ('', *_PRESETS)


def file_format(compression: str = COMPRESSION_FORMATS[0], preset: str = '') -> FileFormat:
    """Return the format of a file.

    Parameters
    ----------
    compression
        One of `COMPRESSION_FORMATS`, for the chunks; it counts without a preset.
    preset
        One of `STORAGE_PRESETS`.
    """
    if preset:
        return _PRESETS[preset]
    return FileFormat(compression='' if compression == 'none' else compression)
