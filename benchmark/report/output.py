"""Output folders: a command replaces its own files, and no others."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path

from benchmark.errors import BenchmarkError, ConfigurationError
from benchmark.files import write_atomically

#: List of the written files with their digests.
LIST = "written.json"

Files = Mapping[str, str | bytes]


def write_files(folder: Path, files: Files, *, force: bool = False) -> None:
    """Write files into a folder, and remove those that the last command wrote there and this one does not.

    Parameters
    ----------
    folder
        The folder, created if necessary.
    files
        Texts or bytes by name.
    force
        Whether to replace files that were edited or come from elsewhere.

    Raises
    ------
    ConfigurationError
        Before anything is written, if a file would be replaced that was edited or that no command has written.
    BenchmarkError
        If the folder cannot be written.
    """
    contents = {name: text.encode() if isinstance(text, str) else text for name, text in files.items()}
    earlier = _earlier(folder)
    for name, data in contents.items():
        present = _digest(folder / name)
        if present and not force and present not in (earlier.get(name), hashlib.sha256(data).hexdigest()):
            what = "was edited" if name in earlier else "was not written by this command"
            raise ConfigurationError(f"{folder / name} {what}", "choose another folder with -o, or pass --force")
    try:
        for name, data in contents.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            write_atomically(folder / name, lambda file, data=data: file.write(data))  # type: ignore[misc]
        for name in earlier.keys() - contents.keys():
            if _digest(folder / name) == earlier[name]:
                (folder / name).unlink()
        digests = {name: hashlib.sha256(contents[name]).hexdigest() for name in sorted(contents)}
        text = json.dumps(digests, indent=0).encode()
        write_atomically(folder / LIST, lambda file: file.write(text))
    except OSError as error:
        raise BenchmarkError(f"cannot write to {folder}: {error.strerror}", "choose another folder with -o") from error


def _earlier(folder: Path) -> dict[str, str]:
    """Return the digests of the files of the last command, without names outside the folder."""
    try:
        listed = json.loads((folder / LIST).read_bytes())
    except (OSError, ValueError, RecursionError):
        return {}
    root = folder.resolve()
    return {
        name: digest
        for name, digest in (listed.items() if isinstance(listed, dict) else ())
        if isinstance(digest, str) and "\0" not in name and (folder / name).resolve().is_relative_to(root)
    }


def _digest(path: Path) -> str:
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError:
        return ""
