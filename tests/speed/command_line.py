"""How long the command line takes to answer."""

from __future__ import annotations

import subprocess
import sys
import time

LIMITS = {("--help",): 0.3, ("list", "methods"): 0.5}


def measure(repeats: int = 7) -> list[dict]:
    """Median time of a whole process for each verb that must answer at once; the peer is a bare interpreter."""
    bare = median(["-c", "pass"], repeats)
    rows = []
    for arguments, limit in LIMITS.items():
        seconds = median(["-m", "benchmark", *arguments], repeats)
        rows.append({
            "name": f"python -m benchmark {' '.join(arguments)}",
            "ours_seconds": seconds,
            "peer": "python -c pass",
            "peer_seconds": bare,
            "ratio": seconds / bare,
            "detail": f"limit {limit} s",
        })  # fmt: skip
    return rows


def median(arguments: list[str], repeats: int) -> float:
    """Median wall time of a Python process."""
    seconds = []
    for _ in range(repeats):
        start = time.perf_counter()
        subprocess.run([sys.executable, *arguments], check=True, stdout=subprocess.DEVNULL)
        seconds.append(time.perf_counter() - start)
    return sorted(seconds)[repeats // 2]


if __name__ == "__main__":
    for row in measure():
        print(row)
