"""Copies of this process that foreign code makes and forgets."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def one_of_us() -> Iterator[None]:
    """End a copy of this process that comes out of the body: both would go on, and copy again."""
    before = os.getpid()
    try:
        yield
    finally:
        if os.getpid() != before:
            os._exit(0)
