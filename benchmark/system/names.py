"""What a method, a data set or a scorer may be called."""

from __future__ import annotations

import re

_NAME = re.compile(r"[a-z][a-z0-9]*(-[a-z0-9]+)*")

#: Characters of the longest name, which becomes part of the names of files.
LONGEST_NAME = 60


#: Words on the command line that stand for several methods, so that none can be called like them.
RESERVED = frozenset({"all", "finished"})


def is_name(name: object) -> bool:
    """Whether something can be called like this: lower-case words joined by hyphens, not too long."""
    return isinstance(name, str) and len(name) <= LONGEST_NAME and _NAME.fullmatch(name) is not None
