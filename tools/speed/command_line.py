"""How long the command line takes to answer."""

from __future__ import annotations

import subprocess
import sys
from functools import partial
from typing import Any

from tools.speed._timing import least_wall_seconds, row

LIMITS = {("--help",): 0.3, ("list", "methods"): 0.5}
REPEATS = 7


def measure() -> list[dict[str, Any]]:
    """Time a whole process for each verb that must answer at once; the peer is a bare interpreter."""
    bare = least_wall_seconds(partial(_run, "-c", "pass"), REPEATS)
    rows = []
    for arguments, limit in LIMITS.items():
        seconds = least_wall_seconds(partial(_run, "-m", "benchmark", *arguments), REPEATS)
        rows.append(
            row(
                f"python -m benchmark {' '.join(arguments)}",
                seconds,
                clock="wall",
                peer="python -c pass",
                peer_seconds=bare,
                target=f"at most {limit} s",
                met=seconds <= limit,
                detail="the start of the interpreter is the floor",
            )
        )
    return rows


def _run(*arguments: str) -> None:
    subprocess.run([sys.executable, *arguments], check=True, stdout=subprocess.DEVNULL)
