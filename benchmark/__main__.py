"""``python -m benchmark``."""

import os
import sys
from contextlib import suppress

# A file in the working folder, such as queue.py, replaces no module of Python. The folder may be
# one that was removed.
with suppress(FileNotFoundError):
    if sys.path[0] in ("", os.getcwd()):  # noqa: PTH109
        sys.path.append(sys.path.pop(0))

try:
    from benchmark.cli.main import program
except KeyboardInterrupt:
    sys.exit(130)

program()
