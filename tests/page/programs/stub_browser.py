"""A browser that writes its arguments, and the file that it opens, as JSON into the file `SEEN`."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from urllib.parse import unquote, urlsplit

path = Path(unquote(urlsplit(sys.argv[1]).path))
facts = {
    'arguments': sys.argv[1:],
    'text': path.read_text('utf-8'),
    'path': str(path),
    'modes': [oct(each.stat().st_mode & 0o777) for each in (path, path.parent)],
}

# The file is complete as soon as it has its name.
new = Path(os.environ['SEEN'] + '.new')
new.write_text(json.dumps(facts), 'utf-8')
new.rename(os.environ['SEEN'])
