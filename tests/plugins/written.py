"""Plugin files made on the fly: a method that goes wrong in one way, when it is imported, made, or at work."""

from __future__ import annotations

from pathlib import Path

_FILE = """
import os, signal, sys, threading, time
from dataclasses import dataclass, field
from typing import Any, ClassVar

from benchmark.api.contracts import MethodInfo, UnsupportedShape

{on_import}


@dataclass(frozen=True, kw_only=True)
class Tried:
    info: ClassVar[MethodInfo] = MethodInfo({info})
    {field}

    def __post_init__(self):
        {on_making}

    def canonicalise(self, shape):
        {at_work}
        return shape.form(shape.mesh.vertices)
"""

#: What a plugin may do wrong at any place, in one statement.
ACTS = {
    "hangs": "time.sleep(3600)",
    "exits": "os._exit(0)",
    "crashes": "os.kill(os.getpid(), signal.SIGSEGV)",
    "raises": "1 / 0",
    "sys-exits": "sys.exit(0)",
    "interrupts": "raise KeyboardInterrupt",
    "refuses": "raise UnsupportedShape('too thin', 'feed it')",
}


def write_plugin(
    path: Path,
    *,
    name: object = "tried",
    on_import: str = "",
    on_making: str = "pass",
    at_work: str = "pass",
    field: str = "",
    info: str = "title='Tried'",
) -> Path:
    """Write a plugin file with one method; ``on_import``, ``on_making`` and ``at_work`` are statements or of ACTS."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(
        _FILE.format(
            on_import=ACTS.get(on_import, on_import),
            on_making=ACTS.get(on_making, on_making),
            at_work=ACTS.get(at_work, at_work),
            field=field,
            info=f"name={name!r}, {info}",
        )
    )
    return path
