"""What the code in records consisted of, so that a plan can name the function that changed.

A record says the digest of each file of code. The file ``runs/code.json`` of a results folder says,
for such a digest, the digests of the functions, methods, classes and constants of the file. Without
it, only the file is named.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

import msgspec

from benchmark.code_digest import definitions_of
from benchmark.files import LARGEST_LIST, read_file, write_atomically
from benchmark.pipeline.cache import RUNS, storing

#: Digests of definitions by name, by the digest of their file.
Definitions = Mapping[str, Mapping[str, str]]


def read_definitions(results: Path) -> Definitions:
    """Return the definitions that are known in a results folder; none if they cannot be read."""
    try:
        content = read_file(definitions_file(results), LARGEST_LIST)
        return msgspec.json.decode(content, type=dict[str, dict[str, str]])
    except (OSError, msgspec.MsgspecError):  # they are for messages alone
        return {}


def keep_definitions(results: Path, codes: Iterable[Mapping[str, str]]) -> None:
    """Add the definitions of code to those of a results folder.

    Parameters
    ----------
    results
        The results folder.
    codes
        Digests of each code by name; see :func:`benchmark.code_digest.code_of`.
    """
    known = read_definitions(results)
    unknown: set[tuple[str, str]] = set()
    for code in codes:
        unknown |= {(name, part) for name, part in code.items() if part not in known}
    new = definitions_of(sorted(unknown))
    if new:
        content = msgspec.json.encode({**known, **new})
        with storing(results):
            write_atomically(definitions_file(results), lambda file: file.write(content))


def changed_definitions(before: str, now: str, known: Definitions) -> list[str]:
    """Return the names of what differs between two digests of a file; none if one is unknown."""
    if before not in known or now not in known:
        return []
    names = {**known[before], **known[now]}
    return [name for name in names if known[before].get(name) != known[now].get(name)]


def definitions_file(results: Path) -> Path:
    """Return the path of the file of definitions in a results folder."""
    return results / RUNS / "code.json"
