"""Names that methods, data sets and scorers may have, and that of the variable which tells where data lies."""

from __future__ import annotations

import re

_NAME = re.compile(r"[a-z][a-z0-9]*(-[a-z0-9]+)*")

#: Characters of the longest name, which becomes part of the names of files.
LONGEST_NAME = 60

#: Environment variable of the folder of the official data sets where ``--data-root`` is not passed.
DATA_VARIABLE = "CANONICAL_FORMS_DATA"

#: Words on the command line that stand for several methods, so that none can be called like them.
RESERVED = frozenset({"all", "finished"})


def is_name(name: object) -> bool:
    """Return whether something can be called like this: lower-case words joined by hyphens, not too long."""
    return isinstance(name, str) and len(name) <= LONGEST_NAME and _NAME.fullmatch(name) is not None
