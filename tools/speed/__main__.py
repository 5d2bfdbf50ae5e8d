"""``make speed``: ours, the peer and the ratio, measured in one run; written to ``results/speed.json``."""

from __future__ import annotations

from benchmark.threads import pin_threads

pin_threads()

import importlib  # noqa: E402
import json  # noqa: E402
import pkgutil  # noqa: E402
import sys  # noqa: E402
from typing import Any  # noqa: E402

import tools.speed  # noqa: E402
from tools.speed._document import SPEED, machine, write_document  # noqa: E402


def main() -> None:
    """Run ``measure`` of the modules that are named, or of all that have one.

    All of them are written. Of those that are named nothing is, unless ``--join`` is among them: then their rows take
    the place of the older ones, and each row says where it was measured: a long measurement can be made in parts.
    """
    names = [module.name for module in pkgutil.iter_modules(tools.speed.__path__) if not module.name.startswith("_")]
    rows = []
    join = "--join" in sys.argv[1:]
    chosen = [name for name in sys.argv[1:] if name != "--join"]
    for name in chosen or names:
        module = importlib.import_module(f"tools.speed.{name}")
        for measured in getattr(module, "measure", list)():
            rows.append({"group": name, **measured})
            print(line(rows[-1]), flush=True)
    if join:
        rows = joined(rows)
    if join or not chosen:
        SPEED.parent.mkdir(exist_ok=True)
        SPEED.write_text(json.dumps({"machine": machine(), "rows": rows}, indent=1) + "\n")
        print(f"wrote {SPEED} and {write_document()}")


def joined(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Rows of the file, with those of the groups that were measured now in their place; each says on what machine."""
    kept = json.loads(SPEED.read_text()) if SPEED.is_file() else {"machine": machine(), "rows": []}
    groups = {row["group"] for row in rows}
    older = [{"machine": kept["machine"], **row} for row in kept["rows"] if row["group"] not in groups]
    return sorted([*older, *({**row, "machine": machine()} for row in rows)], key=lambda row: str(row["group"]))


def line(measured: dict[str, Any]) -> str:
    """One measurement in words."""
    ours = f"{'ok  ' if measured['met'] else 'MISS'} {measured['name']}: {measured['ours_seconds']:.4g} s"
    if not measured["peer"]:
        return f"{ours}; {measured['detail']}"
    peer = f"{measured['peer']}: {measured['peer_seconds']:.4g} s, ratio {measured['ratio']:.2f}"
    return f"{ours}, {peer}; {measured['detail']}"


main()
