"""What commands take where a user names nothing, and words that stand for several things."""

from __future__ import annotations

from pathlib import Path

#: Results folder of commands that name none.
RESULTS = Path("results")

#: Environment variable with the folder of the official data sets, for commands without --data-root.
DATA_VARIABLE = "CANONICAL_FORMS_DATA"

#: Name of the scorer of the tables.
DEFAULT_SCORER = "cm-bof"

#: Word that selects all methods on the command line, so that no method can have it as its name.
ALL_METHODS = "all"
