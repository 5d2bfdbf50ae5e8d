"""What a method answers, looked at before it is used: nothing is cast that would change."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.contracts import Descriptor, Method
from benchmark.errors import InvalidForm, one_line


def real_numbers(method: Method | Descriptor, answer: object, shape: tuple[int | None, ...], mend: str) -> NDArray[Any]:
    """The answer of a method as an array of finite real numbers, float64.

    Parameters
    ----------
    method
        Who answered.
    answer
        What came back.
    shape
        Shape that it must have; None where any length but 0 will do.
    mend
        What the author of the method should do.

    Raises
    ------
    InvalidForm
        If the answer is anything else.
    """
    try:
        found = np.asarray(answer)
    except (TypeError, ValueError, RuntimeError) as error:  # rows of different lengths
        raise InvalidForm(f"method '{method.info.name}' returned no array ({one_line(error)})", mend) from error
    fits = len(found.shape) == len(shape) and all(
        count == wanted if wanted is not None else count for count, wanted in zip(found.shape, shape, strict=True)
    )
    if not fits or found.dtype.kind not in "iuf":
        what = f"an array of shape {found.shape} and type {found.dtype}"
    elif not np.isfinite(found).all():
        what = "an array with NaN or infinite numbers"
    else:
        return found.astype(np.float64)
    raise InvalidForm(f"method '{method.info.name}' returned {what}", mend)
