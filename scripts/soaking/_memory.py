"""How much memory this process has in use."""

from __future__ import annotations

import os
from pathlib import Path


def memory() -> int:
    """Return the resident memory [bytes]."""
    pages = Path('/proc/self/statm').read_text(encoding='ascii').split()[1]
    return int(pages) * os.sysconf('SC_PAGE_SIZE')
