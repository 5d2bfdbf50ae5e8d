"""The suite as somebody at a shell uses it, and depth images to feed it."""

from __future__ import annotations

import io
import os
import runpy
import signal
import subprocess
import sys
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn
from unittest.mock import patch

import numpy as np

ROOT = Path(__file__).parents[2]
HERE = Path(__file__).parent

#: Environment variables of the suite, which the tests set for themselves.
_VARIABLES = ("CANONICAL_FORMS_DATA", "CANONICAL_FORMS_MODELS")


@dataclass(frozen=True)
class Done:
    """How a command ended."""

    code: int
    out: str
    err: str


def environment() -> dict[str, str]:
    """The environment of a command: no data, no models of one's own, a terminal of 100 columns."""
    return {name: value for name, value in os.environ.items() if name not in _VARIABLES} | {
        "COLUMNS": "100"
    }


def call(*words: object) -> Done:
    """Run ``python -m benchmark`` in this process, in the current folder."""
    out, err = (
        io.TextIOWrapper(io.BytesIO(), encoding="utf-8", write_through=True) for _ in range(2)
    )
    handler = signal.getsignal(signal.SIGTERM)
    code: Any = 0

    program, end = os.getpid(), os._exit

    def leave(
        code: int,
    ) -> NoReturn:  # a program may end itself by force, which must not end the tests
        if os.getpid() != program:  # a process that it has forked
            end(code)
        raise SystemExit(code)

    with (
        patch.dict(os.environ, environment(), clear=True),
        patch.object(sys, "argv", ["benchmark", *map(str, words)]),
        patch.object(os, "_exit", leave),
        patch.object(sys, "addaudithook"),  # which would watch the plugins of all later tests
        redirect_stdout(out),
        redirect_stderr(err),
    ):
        try:
            runpy.run_module("benchmark", run_name="__main__")
        except SystemExit as end:
            code = end.code or 0
        finally:
            signal.signal(signal.SIGTERM, handler)
    texts = [stream.buffer.getvalue().decode() for stream in (out, err)]  # type: ignore[attr-defined]
    return Done(code if isinstance(code, int) else 1, *texts)


def start(*words: object, cwd: Path, **options: Any) -> subprocess.Popen[str]:
    """Start ``python -m benchmark`` as a process in a session of its own."""
    command = [sys.executable, "-m", "benchmark", *map(str, words)]
    streams = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE} | options
    return subprocess.Popen(
        command, cwd=cwd, env=environment(), text=True, start_new_session=True, **streams
    )


def write_frames(folder: Path) -> None:
    """Write depth images of two classes: an upright ellipsoid before a wall, thin and thick, in two
    places each.
    """
    v, u = np.mgrid[:240, :320].astype(float)
    ray = np.stack([(u - 159.5) / 262.5, (v - 119.5) / 262.5, np.ones_like(u)], -1)
    folder.mkdir(parents=True, exist_ok=True)
    for name, width in {"lean": 0.2, "stout": 0.35}.items():
        for number, x in enumerate((-0.1, 0.15)):
            centre, axes = np.array([x, 0.0, 2.0]), np.array([width, 0.6, width])
            a, b, c = (
                ((ray if p else centre) * (ray if q else centre) / axes**2).sum(-1)
                for p, q in ((1, 1), (1, 0), (0, 0))
            )
            inside = b * b - a * (c - 1)
            depth = np.where(inside > 0, (b - np.sqrt(np.maximum(inside, 0))) / a, 3.0)
            np.save(folder / f"{name}{number}.npy", depth.round(3).astype(np.float32))
    (folder / "intrinsics.txt").write_text("262.5 0 159.5\n0 262.5 119.5\n0 0 1\n")
