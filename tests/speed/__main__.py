"""``make speed``: ours, the peer and the ratio, measured in one run; written to ``results/speed.json``."""

from __future__ import annotations

from benchmark.threads import pin_threads

pin_threads()

import importlib  # noqa: E402
import json  # noqa: E402
import pkgutil  # noqa: E402
import sys  # noqa: E402
from typing import Any  # noqa: E402

import tests.speed  # noqa: E402
from tests.speed._document import SPEED, machine, write_document  # noqa: E402


def main() -> None:
    """Run ``measure`` of the modules that are named, without writing anything, or of all that have one."""
    names = [module.name for module in pkgutil.iter_modules(tests.speed.__path__) if not module.name.startswith("_")]
    rows = []
    for name in sys.argv[1:] or names:
        module = importlib.import_module(f"tests.speed.{name}")
        for measured in getattr(module, "measure", list)():
            rows.append({"group": name, **measured})
            print(line(rows[-1]), flush=True)
    if not sys.argv[1:]:
        SPEED.parent.mkdir(exist_ok=True)
        SPEED.write_text(json.dumps({"machine": machine(), "rows": rows}, indent=1) + "\n")
        print(f"wrote {SPEED} and {write_document()}")


def line(measured: dict[str, Any]) -> str:
    """One measurement in words."""
    ours = f"{'ok  ' if measured['met'] else 'MISS'} {measured['name']}: {measured['ours_seconds']:.4g} s"
    if not measured["peer"]:
        return f"{ours}; {measured['detail']}"
    peer = f"{measured['peer']}: {measured['peer_seconds']:.4g} s, ratio {measured['ratio']:.2f}"
    return f"{ours}, {peer}; {measured['detail']}"


main()
