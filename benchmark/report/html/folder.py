"""The folder of a report: what was written, what it weighs, and what an earlier report left."""

from __future__ import annotations

import contextlib
import io
import json
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from PIL import Image

from benchmark.errors import BenchmarkError, ConfigurationError
from benchmark.report.html.scripts import data_script
from benchmark.system.files import sweep, write_atomically

#: Names what a report consists of, so that the next one removes what it does not write again, and nothing else.
CONTENTS = "parts/contents.json"

_QUALITY = 84


@dataclass
class Folder:
    """Files of a report, by path relative to its folder.

    Parameters
    ----------
    root
        The folder; made if need be.
    force
        Whether files that no report has written are replaced.
    """

    root: Path
    force: bool = False
    sizes: dict[str, int] = field(default_factory=dict)

    @property
    def size(self) -> int:
        """Bytes that were written."""
        return sum(self.sizes.values())

    def claim(self, names: Iterable[str]) -> None:
        """Make the folder that of a report.

        Raises
        ------
        ConfigurationError
            If something has one of these names that no report has written.
        BenchmarkError
            If the folder cannot be written to.
        """
        if (self.root / CONTENTS).is_file():
            return
        if not self.force and (found := next((name for name in names if (self.root / name).exists()), "")):
            raise ConfigurationError(
                f"{self.root / found} is not of a report",
                "choose another folder with -o, or pass --force to replace it",
            )
        self.write(CONTENTS, "[]")

    def write(self, name: str, content: str | bytes) -> None:
        """Write a file; raises ``BenchmarkError`` if it cannot be written."""
        data = content.encode("utf-8") if isinstance(content, str) else content
        with self._named(name):
            write_atomically(self.root / name, lambda file: file.write(data))
        self.sizes[name] = len(data)

    def script(self, name: str, value: Any) -> None:
        """Write a value as the script that a page loads by this name."""
        self.write(f"parts/data/{name}.js", data_script(name, value))

    def picture(self, name: str, image: Image.Image) -> None:
        """Write a picture in the format that its name ends in, without date or version."""
        stream = io.BytesIO()
        options: dict[str, Any] = {"quality": _QUALITY, "method": 4} if name.endswith(".webp") else {"optimize": True}
        image.save(stream, format="WEBP" if name.endswith(".webp") else "PNG", **options)
        self.write(name, stream.getvalue())

    def finish(self) -> None:
        """Remove what an earlier report wrote here and this one did not."""
        for name in self._earlier():
            if name not in self.sizes and self._is_inside(name):
                with contextlib.suppress(OSError):
                    (self.root / name).unlink()
        self.write(CONTENTS, json.dumps(sorted({*self.sizes, CONTENTS}), indent=0))
        sweep(self.root, deep=False)
        sweep(self.root / "parts")

    def _earlier(self) -> Iterator[str]:
        try:
            names = json.loads((self.root / CONTENTS).read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError):
            return
        if isinstance(names, list):
            yield from (name for name in names if isinstance(name, str))

    def _is_inside(self, name: str) -> bool:
        try:
            return (self.root / name).resolve().is_relative_to(self.root.resolve())
        except (OSError, ValueError):
            return False

    @contextlib.contextmanager
    def _named(self, name: str) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise BenchmarkError(
                f"cannot write {self.root / name}: {error.strerror}", "free some space or choose another folder with -o"
            ) from error


Progress = Callable[[str], None]
"""Takes a line about what is being done."""
