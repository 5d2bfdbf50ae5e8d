"""Data as scripts: a page that is opened from a folder may not fetch files, but it may load a script."""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.system.text import clean

#: What means something to a reader of HTML, where a script stands in a page.
_IN_HTML = {"<": "\\u003c", ">": "\\u003e", "&": "\\u0026"}


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


def packed(array: NDArray[Any]) -> str:
    """An array of unsigned whole numbers as base64, little-endian, in the order of its memory."""
    return base64.b64encode(np.ascontiguousarray(array, dtype=array.dtype.newbyteorder("<")).tobytes()).decode("ascii")


def quantised(points: NDArray[np.float64], reach: float) -> NDArray[np.uint16]:
    """Coordinates between ``-reach`` and ``reach``, shape (n, 3), in 65536 steps; what lies beyond is moved in."""
    steps = np.rint((np.clip(points / reach, -1, 1) + 1) / 2 * 65535)
    return np.asarray(steps, dtype=np.uint16)


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
