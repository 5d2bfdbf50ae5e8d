"""The reference: the measures and mean distances of every query of small galleries, committed in ``reference.json``.

``python -m tools.reference`` runs every method on two poses of two subjects of each data set again and names
the rows that differ in six digits; ``--accept`` writes them. Mean distances show what no ranking of so few shapes does.
"""

from __future__ import annotations

import argparse
import io
import json
import math
import os
import sys
from collections.abc import Mapping, Sequence
from contextlib import redirect_stdout
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from unittest.mock import patch

from benchmark.api.datasets import Entry
from benchmark.cli.main import cli
from benchmark.datasets.base import thinned
from benchmark.machine import pin_threads
from benchmark.pipeline.records import read_distances, read_records
from benchmark.protocols import galleries
from benchmark.protocols.models import MODELS_VARIABLE
from benchmark.registry import BUILT_IN

REFERENCE = Path(__file__).with_name("reference.json")

MEASURES = ("NN", "FT", "ST", "DCG")

SETS = (
    "people[draw=0]", "humans-scanlike", "animals", "tosca", "animals-few[holes=3]",
    "animals-few[depth-noise=3]",
)  # fmt: skip

#: Values that differ by less are equal: six digits, of which the last may have been rounded either way.
TOLERANCE = 1.5e-6

#: By gallery, input and method: values of its queries by name, or its status.
Rows = dict[str, dict[str, list[Any]]]


def few(entries: tuple[Entry, ...], most: int) -> tuple[Entry, ...]:
    """Return two poses of two subjects, in place of what ``--quick`` keeps."""
    subjects = list(dict.fromkeys(entry.subject for entry in entries))
    chosen = subjects[:: -(-len(subjects) // 2)]
    return thinned(tuple(entry for entry in entries if entry.subject in chosen), 2)


def make(folder: Path, sets: Sequence[str], methods: Sequence[str] = ()) -> Rows:
    """Run all methods, or some, on small galleries of the sets."""
    chosen = [word for name in methods or BUILT_IN for word in ("-m", name)]
    words = [word for name in sets for word in ("-d", name)]
    with patch.object(galleries, "thinned", few), patch.dict(os.environ), redirect_stdout(io.StringIO()):
        os.environ.pop(MODELS_VARIABLE, None)
        if cli(["run", "--quick", *chosen, *words, "--results", str(folder)], standalone_mode=False) not in (
            None,
            0,
            1,
        ):
            sys.exit("the run was stopped")  # code 1: rows that cannot be made are part of the reference
    rows: Rows = {}
    for record in read_records(folder, published=False):
        name = f"{record.gallery}, {record.input}, {record.method}"
        if record.status != "ok":
            rows[name] = {"status": [record.status]}
            continue
        distances = read_distances(folder, record)
        assert distances is not None
        means = dict(zip(record.answered, distances.sum(axis=0) / max(len(distances) - 1, 1), strict=True))
        values = {measure: record.per_query[measure] for measure in MEASURES}
        values["distance"] = [means.get(number) for number in range(len(record.shapes))]
        rows[name] = {key: [None if x is None else float(f"{x:.6g}") for x in row] for key, row in values.items()}
    return rows


def compare(before: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """Return a line for each row that is missing, new, or differs: in what, and by how much at most."""
    lines = [f"{row}: {'new' if row in now else 'missing'}" for row in sorted(before.keys() ^ now.keys())]
    for row in sorted(before.keys() & now.keys()):
        found = [f"{name} {text}" for name in now[row] if (text := _difference(before[row].get(name), now[row][name]))]
        lines += [f"{row}: {', '.join(found)}"] if found else []
    return lines


def _difference(before: list[Any] | None, now: list[Any]) -> str:
    if before is None or len(before) != len(now):
        return "of other queries"
    pairs = [(a, b) for a, b in zip(before, now, strict=True) if a != b]
    if any(not isinstance(x, (int, float)) for pair in pairs for x in pair):
        return f"{pairs[0][0]} -> {pairs[0][1]}"
    apart = [abs(a - b) for a, b in pairs if not math.isclose(a, b, rel_tol=TOLERANCE, abs_tol=TOLERANCE)]
    return f"by {max(apart):.2g}" if apart else ""


def main() -> int:
    """Make the reference, and compare it or accept it."""
    parser = argparse.ArgumentParser(prog="python -m tools.reference", description=__doc__)
    parser.add_argument("--accept", action="store_true", help="write the rows that were made")
    parser.add_argument("-d", dest="sets", action="append", choices=SETS, help="these sets alone")
    parser.add_argument("-m", dest="methods", action="append", default=[], help="these methods alone")
    given = parser.parse_args()
    pin_threads()
    sets = [name for name in given.sets or SETS if name != "tosca" or "CANONICAL_FORMS_DATA" in os.environ]
    with TemporaryDirectory() as folder:
        now = make(Path(folder), sets, given.methods)
    known: Rows = json.loads(REFERENCE.read_text(encoding="utf-8"))
    if given.accept:
        rows = now if sets == [*SETS] and not given.methods else known | now
        lines = (f"{json.dumps(row)}: {json.dumps(rows[row])}" for row in sorted(rows))
        REFERENCE.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")
        return 0
    methods = set(given.methods or BUILT_IN)
    chosen = {row: values for row, values in known.items() if _is_made(row, sets, methods)}
    differing = compare(chosen, now)
    print(*differing, f"{len(differing)} of {len(now)} rows differ", sep="\n")
    return int(bool(differing))


def _is_made(row: str, sets: Sequence[str], methods: set[str]) -> bool:
    gallery, _, method = row.split(", ")
    return method.partition("[")[0] in methods and gallery.partition(" ")[0] in sets


if __name__ == "__main__":
    sys.exit(main())
