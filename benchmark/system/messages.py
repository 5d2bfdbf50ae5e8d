"""Messages between processes of which one runs foreign code: JSON and arrays, never objects."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.system.arrays import load_arrays, save_arrays

Arrays = Mapping[str, NDArray[Any]]

#: Array that holds the facts of a message, and the key that every message is kept under.
_FACTS = "__facts__"
_KEY = "message"


def packed(facts: Mapping[str, Any], arrays: Arrays) -> bytes:
    """Return facts, which JSON can tell, and arrays as bytes; raises ``ValueError`` for arrays of objects."""
    file = io.BytesIO()
    save_arrays(file, _KEY, {**arrays, _FACTS: np.array(json.dumps(facts))}, compressed=False)
    return file.getvalue()


def unpacked(content: bytes) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Return the facts and the arrays of a message.

    Raises
    ------
    Exception
        Of many kinds, if it is no message: whoever sent it may send anything.
    """
    arrays = load_arrays(io.BytesIO(content), _KEY)
    facts = json.loads(str(arrays.pop(_FACTS)))
    if not isinstance(facts, dict):
        raise TypeError("the facts of a message have no names")
    return facts, arrays
