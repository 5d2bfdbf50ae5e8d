"""``python -m benchmark``."""

import os
import sys

# A file in the working folder, such as queue.py, replaces no module of Python.
if sys.path[0] in ("", os.getcwd()):  # noqa: PTH109
    sys.path.append(sys.path.pop(0))

from benchmark.cli.main import program

program()
