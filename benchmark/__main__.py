"""``python -m benchmark``."""

import os
import sys

if sys.path[0] in ("", os.getcwd()):  # noqa: PTH109  # a file there, such as queue.py, replaces no module of Python
    sys.path.append(sys.path.pop(0))

from benchmark.cli.main import program

program()
