"""The folder of a report: what was written, what it weighs, and what an earlier report left.

Data travels as scripts: a page that is opened from a folder may not fetch files, but it may load a script.
"""

from __future__ import annotations

import contextlib
import io
import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from benchmark.errors import BenchmarkError, ConfigurationError
from benchmark.files import sweep, write_atomically
from benchmark.text import clean

#: Names what a report consists of, so that the next one removes what it does not write again, and nothing else.
CONTENTS = "parts/contents.json"

_QUALITY = 84

#: What means something to a reader of HTML, where a script stands in a page.
_IN_HTML = {"<": "\\u003c", ">": "\\u003e", "&": "\\u0026"}


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
        sweep(self.root / "parts")
        with contextlib.suppress(OSError):
            (self.root / "parts").rmdir()  # of a report that was killed before it wrote anything
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


def script_json(value: Any) -> str:
    r"""JSON that is also JavaScript, and text within a script of a page, whatever its strings hold.

    Strings are cleaned as everywhere; what is not ASCII is escaped, U+2028 and halves of characters among it, and so
    are the marks of HTML. A number that JSON does not have becomes ``null``.
    """
    text = json.dumps(_plain(value), ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    for mark, escaped in _IN_HTML.items():
        text = text.replace(mark, escaped)
    return text


def data_script(name: str, value: Any) -> str:
    """A script that hands a value to the page that loads it; ``name`` is what the page asked for."""
    return f"canonicalForms.receive({script_json(name)},{script_json(value)});\n"


def _plain(value: Any) -> Any:
    """The same with cleaned strings and without numbers that JSON lacks."""
    if isinstance(value, str):
        return clean(value)
    if isinstance(value, Mapping):
        return {clean(name): _plain(part) for name, part in value.items()}
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, list | tuple):
        return [_plain(part) for part in value]
    if isinstance(value, float | np.floating):
        return float(value) if np.isfinite(value) else None
    if isinstance(value, np.integer):
        return int(value)
    return value
