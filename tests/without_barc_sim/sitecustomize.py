"""Makes a Python that has no barc_sim, when this folder is first on its path."""

import sys

sys.modules['barc_sim'] = None  # type: ignore[assignment]
