"""The folder of a paper: what this verb wrote is written anew, what its author has changed is kept."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from pathlib import Path

from benchmark.errors import BenchmarkError, ConfigurationError
from benchmark.files import sweep, write_atomically, write_text

#: Digests of what this verb has written, by name, so that what was changed since is known.
CONTENTS = "written-by-paper.json"


def write_folder(files: Mapping[str, bytes], root: Path, *, force: bool = False) -> list[str]:
    """Write the files of a paper, and remove those of an earlier one that are not among them.

    Parameters
    ----------
    files
        Contents by name.
    root
        The folder; made if need be.
    force
        Whether to replace files that are somebody else's, or that their author has changed.

    Returns
    -------
    list of str
        Names of the files that were left as their author has changed, or put, them there.

    Raises
    ------
    ConfigurationError
        If no paper is there, and one would take the place of a file of somebody else. Not with force.
    BenchmarkError
        If they cannot be written.
    """
    earlier = _earlier(root)
    found = {name: digest for name in {*files, *earlier} if (digest := _digest(root, name))}
    digests = {name: hashlib.sha256(data).hexdigest() for name, data in files.items()}
    if not (force or earlier) and (strange := [name for name in files if name in found]):
        raise ConfigurationError(
            f"{root / strange[0]} was not written by 'paper'",
            "choose another folder with -o, or pass --force to replace it",
        )
    kept = [name for name in files if name in found and found[name] not in (*earlier.get(name, ()), digests[name])]
    kept = [] if force else kept
    try:
        # Stopped before the end, it takes neither what it has written nor what it has not for another's.
        _tell(root, earlier | {name: [*earlier.get(name, ()), digest] for name, digest in digests.items()})
        for name, data in files.items():
            if name not in kept:
                write_atomically(root / name, lambda file, data=data: file.write(data))  # type: ignore[misc]
        for name in earlier.keys() - files.keys():
            if found.get(name) in earlier[name]:
                (root / name).unlink()
        left = {name: told for name, told in earlier.items() if name not in files and (root / name).exists()}
        _tell(root, left | {name: earlier.get(name, []) if name in kept else [digests[name]] for name in files})
        for folder in {(root / name).parent for name in files}:
            sweep(folder, deep=False)
    except OSError as error:
        raise BenchmarkError(
            f"cannot write to {root}: {error.strerror}", "free some space or choose another folder with -o"
        ) from error
    return kept


def _tell(root: Path, digests: Mapping[str, Iterable[str]]) -> None:
    write_text(root / CONTENTS, json.dumps({name: [*digests[name]] for name in sorted(digests)}, indent=0) + "\n")


def _earlier(root: Path) -> dict[str, list[str]]:
    """Digests of what earlier papers have written; a name that leads out of the folder is none."""
    try:
        told = json.loads((root / CONTENTS).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    return {
        name: [each for each in digests if isinstance(each, str)]
        for name, digests in (told.items() if isinstance(told, dict) else ())
        if isinstance(digests, list) and (root / name).resolve().is_relative_to(root.resolve())
    }


def _digest(root: Path, name: str) -> str:
    """Digest of a file; "" where there is none."""
    try:
        return hashlib.sha256((root / name).read_bytes()).hexdigest()
    except OSError:
        return ""
