"""Parts of the code that ran: regions of source files, told by the instructions that the interpreter executed."""

from __future__ import annotations

import sys
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

#: First and last line and column of a part of a file, as the syntax tree counts them.
Region = tuple[int, int, int, int]

#: Bytes from one instruction to the next.
_STEP = 2

#: Instructions after which nobody waits any more for a region of a function that is called again and again.
_PATIENCE = 2_000_000


class Reached:
    """Watches which regions are executed.

    A region counts when an instruction ran that was made from it alone; where there is none, for the compiler folded
    it, one of the shortest that encloses it.

    Parameters
    ----------
    regions
        Regions by file, relative to the root, each with the name under which it is told.
    root
        Folder of the tree.
    """

    def __init__(self, regions: Mapping[str, Mapping[str, Sequence[int]]], root: Path) -> None:
        self.found: set[str] = set()
        self._wanted: dict[tuple[str, str, int], dict[int, list[str]]] = {}
        self._patience: dict[CodeType, int] = {}
        self._files: dict[str, bool] = {}
        for file, named in regions.items():
            path = root / file
            code = compile(path.read_bytes(), str(path), "exec", dont_inherit=True)
            places = list(_instructions(code))
            for name, region in named.items():
                for key, offset in _made_from(tuple(region), places):  # type: ignore[arg-type]
                    self._wanted.setdefault((str(path), *key), {}).setdefault(offset, []).append(name)
            self._files[str(path)] = True

    @contextmanager
    def watching(self) -> Iterator[None]:
        """Watch what runs in the body, in all threads."""
        if not self._files:
            yield
            return
        before = sys.gettrace()
        threading.settrace(self._call)
        sys.settrace(self._call)
        try:
            yield
        finally:
            sys.settrace(before)
            threading.settrace(before)

    def _call(self, frame: FrameType, event: str, argument: Any) -> Any:
        code = frame.f_code
        if code.co_filename not in self._files:
            return None
        wanted = self._wanted.get((code.co_filename, code.co_qualname, code.co_firstlineno))
        if not wanted or self._patience.get(code, 0) > _PATIENCE:
            return None
        frame.f_trace_opcodes, frame.f_trace_lines = True, False

        def step(frame: FrameType, event: str, argument: Any) -> Any:
            if event == "opcode":
                self._patience[code] = self._patience.get(code, 0) + 1
                if names := wanted.pop(frame.f_lasti, ()):
                    self.found.update(names)
                    for offset in [o for o, others in wanted.items() if self.found.issuperset(others)]:
                        del wanted[offset]
            return step if wanted else None

        return step


def _instructions(code: CodeType) -> Iterator[tuple[tuple[str, int], int, Region]]:
    """Function, offset and region of each instruction, nested functions included."""
    key = (code.co_qualname, code.co_firstlineno)
    for number, (line, end_line, column, end_column) in enumerate(code.co_positions()):
        if line is not None and end_line is not None and column is not None and end_column is not None:
            yield key, _STEP * number, (line, column, end_line, end_column)
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _instructions(constant)


def _made_from(
    region: Region, places: Sequence[tuple[tuple[str, int], int, Region]]
) -> list[tuple[tuple[str, int], int]]:
    """Function and offset of the instructions that show that a region ran."""
    inside = [(key, offset) for key, offset, place in places if _encloses(region, place)]
    if inside:
        return inside
    around = [(_extent(place), key, offset) for key, offset, place in places if _encloses(place, region)]
    shortest = min((extent for extent, _, _ in around), default=None)
    return [(key, offset) for extent, key, offset in around if extent == shortest]


def _encloses(outer: Region, inner: Region) -> bool:
    return outer[:2] <= inner[:2] and inner[2:] <= outer[2:]


def _extent(region: Region) -> tuple[int, int]:
    return region[2] - region[0], region[3] - region[1]
