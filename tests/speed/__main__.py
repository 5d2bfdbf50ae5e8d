"""``make speed``: ours, the peer and the ratio, measured in one run; written to ``results/speed.json``."""

from __future__ import annotations

import importlib
import json
import pkgutil
import platform
import sys
from pathlib import Path

import psutil

import tests.speed
from benchmark.threads import pin_threads

RESULT = Path("results/speed.json")


def main() -> None:
    """Run every ``measure`` of this package whose name is asked for, or all."""
    pin_threads()
    names = [module.name for module in pkgutil.iter_modules(tests.speed.__path__) if not module.name.startswith("_")]
    rows = []
    for name in sys.argv[1:] or names:
        module = importlib.import_module(f"tests.speed.{name}")
        for row in module.measure():
            rows.append({"group": name, **row})
            print(line(rows[-1]), flush=True)
    if not sys.argv[1:]:
        machine = {"system": platform.platform(), "python": platform.python_version(), "cores": psutil.cpu_count()}
        RESULT.parent.mkdir(exist_ok=True)
        RESULT.write_text(json.dumps({"machine": machine, "rows": rows}, indent=1) + "\n")
        print(f"wrote {RESULT}")


def line(row: dict) -> str:
    """One measurement in words."""
    ours = f"{row['name']}: {row['ours_seconds']:.4g} s"
    if not row.get("peer_seconds"):
        return f"{ours}  {row['detail']}"
    return f"{ours}, {row['peer']}: {row['peer_seconds']:.4g} s, ratio {row['ratio']:.2f}  {row['detail']}"


main()
