"""``python -m tools.speed [GROUP ...]``: measure all groups, or those that are named, and print the table."""

from __future__ import annotations

from benchmark.threads import pin_threads

pin_threads()

import importlib  # noqa: E402
import platform  # noqa: E402
import sys  # noqa: E402
from pathlib import Path  # noqa: E402

import psutil  # noqa: E402

from benchmark.report.escaping import markdown_table  # noqa: E402
from tools.speed.timing import Row  # noqa: E402

GROUPS = ("geodesics", "forms", "scorer", "network", "programs")
HEADER = ("what", "ours", "other program", "its time", "ratio", "clock", "how it was measured")


def main() -> None:
    """Print each row as it is measured to stderr, and the table in the end."""
    rows: list[Row] = []
    for group in sys.argv[1:] or GROUPS:
        for row in importlib.import_module(f"tools.speed.{group}").measure():
            print(" | ".join(row.cells()), file=sys.stderr, flush=True)
            rows.append(row)
    print("\n".join(markdown_table(HEADER, [row.cells() for row in rows], n_left=len(HEADER))))
    print(f"\nMeasured on {machine()}.")


def machine() -> str:
    """System, processor, Python and cores."""
    processor = platform.processor()
    if (info := Path("/proc/cpuinfo")).exists():
        names = [line.partition(": ")[2] for line in info.read_text().splitlines() if line.startswith("model name")]
        processor = names[0] if names else processor
    python = platform.python_version()
    return f"{platform.system()} {platform.machine()} ({processor}), Python {python}, {psutil.cpu_count()} cores"


main()
