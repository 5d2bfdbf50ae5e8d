"""Files beside the pages of a report: pictures, and data as scripts.

A page that is opened from a folder may not fetch files, but it may load a script.
"""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from PIL import Image

from benchmark.text import clean

#: Contents of files by their path in the folder of the report.
Files = dict[str, bytes]

Progress = Callable[[str], None]
"""Takes a line about what is being done."""

#: What means something to a reader of HTML, where a script stands in a page.
_IN_HTML = {"<": "\\u003c", ">": "\\u003e", "&": "\\u0026"}


def add_script(files: Files, name: str, value: Any) -> None:
    """Add a value as the script that a page loads by this name."""
    text = f"canonicalForms.receive({script_json(name)},{script_json(value)});\n"
    files[f"parts/data/{name}.js"] = text.encode()


def add_picture(files: Files, name: str, image: Image.Image) -> str:
    """Add a picture, without date or version, and return its path."""
    stream = io.BytesIO()
    image.save(stream, format="WEBP", quality=84, method=4)
    files[f"parts/pictures/{name}.webp"] = stream.getvalue()
    return f"parts/pictures/{name}.webp"


def script_json(value: Any) -> str:
    """JSON that is also JavaScript, and text within a script of a page, whatever its strings hold.

    What is not ASCII is escaped, and so are the marks of HTML. A number that JSON does not have becomes ``null``.
    """
    text = json.dumps(_plain(value), ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    for mark, escaped in _IN_HTML.items():
        text = text.replace(mark, escaped)
    return text


def _plain(value: Any) -> Any:
    """The same with cleaned strings, and without numbers that JSON lacks."""
    if isinstance(value, str):
        return clean(value)
    if isinstance(value, Mapping):
        return {clean(name): _plain(part) for name, part in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(part) for part in value]
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist())
    return None if isinstance(value, float) and not np.isfinite(value) else value
