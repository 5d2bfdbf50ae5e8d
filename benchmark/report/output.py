"""Output folders: a command replaces its own files, and keeps files that were edited or come from elsewhere."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from benchmark.errors import BenchmarkError, ConfigurationError
from benchmark.files import sweep, write_atomically, write_text

#: Number of leading characters that identify a table without a list of files: its kind and name, but no scores.
_HEAD = 16


@dataclass(frozen=True)
class Folder:
    """Folder to which a command writes.

    Parameters
    ----------
    root
        The folder, created if necessary.
    verb
        Name of the command.
    contents
        File with the digests of the written files, which identifies edited and obsolete files. Without it, a file
        belongs to the command if it starts like the new one.
    force
        Whether to replace files that were edited or come from elsewhere.
    """

    root: Path
    verb: str
    contents: str = ""
    force: bool = False

    def require_own(self, names: Iterable[str]) -> None:
        """Raise ``ConfigurationError`` if one of these files comes from elsewhere, unless ``force``."""
        strange = next((name for name in names if (self.root / name).exists()), None)
        if strange and not self.force and not self._earlier({}):
            raise self._strange(strange)

    def write(self, files: Mapping[str, bytes]) -> list[str]:
        """Write files, and remove those of the previous list that are not among them.

        Returns
        -------
        list of str
            Names of the files that were kept because they were edited or come from elsewhere.

        Raises
        ------
        ConfigurationError
            If one would replace a file from elsewhere, unless ``force``.
        BenchmarkError
            If they cannot be written.
        """
        root, earlier = self.root, self._earlier(files)
        digests = {name: hashlib.sha256(data).hexdigest() for name, data in files.items()}
        present = {name: digest for name in {*files, *earlier} if (digest := self._digest(name))}
        strange = [name for name in files if name in present and name not in earlier]
        if strange and not self.force and not (self.contents and earlier):
            raise self._strange(strange[0])
        edited = [n for n in files if n in present and present[n] not in (*earlier.get(n, ()), digests[n])]
        edited = [] if self.force else edited
        try:
            # If interrupted, neither old nor new files count as foreign next time.
            self._list(earlier | {name: [*earlier.get(name, ()), digest] for name, digest in digests.items()})
            for name, data in files.items():
                if name not in edited:
                    write_atomically(root / name, lambda file, data=data: file.write(data))  # type: ignore[misc]
            for name in earlier.keys() - files.keys():
                if present.get(name) in earlier[name]:
                    (root / name).unlink()
            left = {name: of_file for name, of_file in earlier.items() if name not in files and (root / name).exists()}
            self._list(left | {name: earlier.get(name, []) if name in edited else [digests[name]] for name in files})
            for folder in {(root / name).parent for name in files}:
                sweep(folder, deep=False)
        except OSError as error:
            raise BenchmarkError(
                f"cannot write to {root}: {error.strerror}", "free some space or choose another folder with -o"
            ) from error
        return edited

    def stale(self, files: Mapping[str, bytes]) -> list[str]:
        """Return the names of files that are missing or differ from the given content."""
        return [name for name, data in files.items() if self._digest(name) != hashlib.sha256(data).hexdigest()]

    def _strange(self, name: str) -> ConfigurationError:
        return ConfigurationError(
            f"{self.root / name} was not written by '{self.verb}'",
            "choose another folder with -o, or pass --force to replace it",
        )

    def _list(self, digests: Mapping[str, Iterable[str]]) -> None:
        if self.contents:
            lists = {name: [*digests[name]] for name in sorted(digests)}
            write_text(self.root / self.contents, json.dumps(lists, indent=0) + "\n")

    def _earlier(self, files: Mapping[str, bytes]) -> dict[str, list[str]]:
        """Return the digests of the previous files, without names outside the folder."""
        if not self.contents:
            own = (name for name, data in files.items() if data[:_HEAD] == self._read(name)[:_HEAD])
            return {name: [self._digest(name)] for name in own}
        try:
            listed = json.loads(self._read(self.contents))
        except (ValueError, RecursionError):
            return {}
        return {
            name: [digest for digest in digests if isinstance(digest, str)]
            for name, digests in (listed.items() if isinstance(listed, dict) else ())
            if isinstance(digests, list)
            and "\0" not in name
            and (self.root / name).resolve().is_relative_to(self.root.resolve())
        }

    def _read(self, name: str) -> bytes:
        """Return the content of a file; empty if it cannot be read."""
        try:
            return (self.root / name).read_bytes()
        except OSError:
            return b""

    def _digest(self, name: str) -> str:
        """Return the digest of a file; "" if there is none."""
        return hashlib.sha256(self._read(name)).hexdigest() if (self.root / name).is_file() else ""
