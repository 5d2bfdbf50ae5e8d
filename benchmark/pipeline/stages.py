"""What all stages of the pipeline share: arrays, why there are none, and the time they took."""

from __future__ import annotations

import errno
import resource
import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.errors import (
    BenchmarkError,
    InvalidForm,
    InvalidSignature,
    ShapeError,
    UnsupportedShape,
)

Arrays = Mapping[str, NDArray[Any]]
"""Content of a file of the cache."""

#: Prefix of the names of arrays that are notes on a shape.
NOTE = "note:"

#: Array that says why there is no result; a scorer can call none of its own so.
REFUSED = ":refused"

#: Array with the seconds that a stage took (:func:`clock`); a scorer can call none of its own so.
SECONDS = ":seconds"

#: Ending of the name of the array with the seconds of geodesics, which are charged to no method.
GEODESICS = ":geodesics"

#: Array that says on which machine a form was computed.
MACHINE = ":machine"


class Incomplete(BenchmarkError):
    """A shape has no result for a reason that is not in its content, such as a read error.

    Nothing of it is kept.

    Parameters
    ----------
    problem
        What goes on after the name of the shape.
    """

    def __init__(self, problem: str) -> None:
        super().__init__(problem, "run again")


def clock() -> NDArray[np.float64]:
    """Return seconds of the wall and of the processor.

    Those of the processor are user and system time of this process and its ended children.
    """
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    of_processor = time.process_time() + children.ru_utime + children.ru_stime
    return np.array([time.perf_counter(), of_processor])


def timed(compute: Callable[[], Arrays]) -> Arrays:
    """Compute arrays for the cache, and add the seconds that this took.

    Parameters
    ----------
    compute
        Computes the arrays, or raises ``ShapeError`` to refuse the shape.

    Returns
    -------
    dict
        The arrays, or in their place the reason and hint of the refusal; and the seconds, by the
        clock on the wall and of the processor.

    Raises
    ------
    InvalidForm, InvalidSignature
        If a method or a scorer returned no valid result.
    Incomplete
        If the cause may pass, such as a lack of memory or a read error.
    """
    start = clock()
    try:
        arrays = compute()
    except (InvalidForm, InvalidSignature):  # these are no faults of the shape
        raise
    except ShapeError as error:
        if _is_temporary(error):
            raise Incomplete(f"has no result: {error.problem}") from error
        arrays = {REFUSED: np.array([error.problem, error.hint])}
    return {**arrays, SECONDS: clock() - start}


def _is_temporary(error: BaseException | None) -> bool:
    """Return whether an error comes from memory, or from reading a file that is there."""
    while error is not None:
        is_read_error = isinstance(error, OSError) and error.errno not in (None, errno.ENOENT)
        if is_read_error or isinstance(error, MemoryError):
            return True
        error = error.__cause__
    return False


def require_result(arrays: Arrays) -> Arrays:
    """Return the arrays of a stage; raise ``UnsupportedShape`` if it refused the shape."""
    if REFUSED in arrays:
        raise UnsupportedShape(*arrays[REFUSED].tolist())
    return arrays
