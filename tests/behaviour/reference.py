"""The reference: values of every row on small galleries of every data set, committed in ``reference.json``.

``python -m tests.behaviour.reference`` makes them again and names the rows that differ in six digits; ``--accept``
writes them, those of some methods where ``-m`` names them. Of each query of a row there are its measures, and its mean
distance to the other shapes, which shows what no ranking of so few shapes does.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from unittest.mock import patch

from benchmark.api.datasets import Entry
from benchmark.datasets.base import thinned
from benchmark.protocols import galleries
from benchmark.report.results import open_results
from tests.behaviour.suite import HERE, MEASURES, call

REFERENCE = HERE / "reference.json"

#: Sets that ``run --paper --quick`` ranks, the paper's rows by the default scorer. Of the stand-ins the same rows are
#: among those of :data:`ALL_SETS`; ranked quick as well, they would take another half an hour.
QUICK_SETS = ("tosca",)

#: Sets that every row is made of, by every scorer. Sets that are a part of one of these are left out.
ALL_SETS = (
    "humans", "people[draw=0]", "humans-scanlike", "animals", "tosca", "camera", "animals-few[holes=3]",
    "animals-few[depth-noise=3]",
)  # fmt: skip

#: Rows of published tables that no list of methods names: of a shipped model for other data.
FURTHER_ROWS = ("learned-wide-extra[training=animals-sampled]",)

#: Methods of another library, which hold ours to account, and which take as long as all others together.
OTHER_LIBRARY = "scikit-learn-"

#: Subjects and poses of each that are ranked there, evenly spread.
SUBJECTS, POSES = 2, 2

#: Values that differ by less are equal: six digits, of which the last may have been rounded either way.
TOLERANCE = 1.5e-6

#: By row: part of the reference, gallery, input, method and scorer; what its queries have by name.
Rows = dict[str, dict[str, list[Any]]]


def listed(what: str) -> list[dict[str, Any]]:
    """What ``list --json`` says."""
    return json.loads(call("list", what, "--json").out)


def few(entries: tuple[Entry, ...], most: int) -> tuple[Entry, ...]:
    """Keep some poses of some subjects, in place of what ``--quick`` keeps."""
    subjects = list(dict.fromkeys(entry.subject for entry in entries))
    chosen = subjects[:: -(-len(subjects) // SUBJECTS)]
    return thinned(tuple(entry for entry in entries if entry.subject in chosen), POSES)


def make(folder: Path, data: Path | None, sets: Sequence[str], methods: Sequence[str] = ()) -> Rows:
    """Run what the reference is made of, and collect it.

    Parameters
    ----------
    folder
        Where results go.
    data
        The folder that holds TOSCA.
    sets
        Data sets; see :data:`ALL_SETS`.
    methods
        Of every row those of some methods alone, without the rows of the paper; all by default.
    """
    root = ("--data-root", data) if data else ()
    quick, every = folder / "quick", folder / "every"
    if not methods:
        for name in filter(QUICK_SETS.__contains__, sets):
            _run("--paper", "--quick", "-d", name, "--results", quick, *root)
    own = (row["name"] for row in listed("methods") if not row["name"].startswith(OTHER_LIBRARY))
    names = methods or [*own, *FURTHER_ROWS]
    chosen = [word for name in names for word in ("-m", name)] + [word for name in sets for word in ("-d", name)]
    with patch.object(galleries, "thinned", few):
        for scorer in listed("scorers"):
            _run("--quick", *chosen, "--scorer", scorer["name"], "--results", every, *root)
    return dict(row for part in (quick, every) if part.exists() for row in _rows(part, data))


def _run(*words: object) -> None:
    done = call("run", *words, is_shown=True)
    if done.code not in (0, 1):  # some rows cannot be made: they are part of the reference
        sys.exit(done.code)


def _rows(folder: Path, data: Path | None) -> Iterator[tuple[str, dict[str, list[Any]]]]:
    results = open_results(folder, data_root=data)
    for record in results.records().itertuples():
        row = f"{folder.name}, {record.gallery}, {record.input}, {record.method}, {record.scorer or 'descriptor'}"
        if record.status != "ok":
            yield row, {"status": [record.status]}
            continue
        queries = results.queries(record.Index)
        distances = results.distances(record.Index)
        means = (distances.sum() / max(len(distances) - 1, 1)).reindex(queries["shape"])
        columns = {name: queries[name] for name in MEASURES} | {"distance": means}
        yield row, {name: [None if math.isnan(x) else float(f"{x:.6g}") for x in columns[name]] for name in columns}
        yield f"{folder.name}, {record.gallery}", {"shape": queries["shape"].tolist()}


def compare(before: Mapping[str, Mapping[str, list[Any]]], now: Mapping[str, Mapping[str, list[Any]]]) -> list[str]:
    """Return a line for each row that is missing, new, or differs: in what, for how many queries, by how much."""
    lines = []
    for row in dict.fromkeys([*before, *now]):
        if row not in now or row not in before:
            lines.append(f"{row}: {'new' if row in now else 'missing'}")
            continue
        names = dict.fromkeys([*before[row], *now[row]])
        differences = [text for name in names if (text := _difference(before[row].get(name), now[row].get(name), name))]
        lines += [f"{row}: {'; '.join(differences)}"] if differences else []
    return lines


def _difference(before: list[Any] | None, now: list[Any] | None, name: str) -> str:
    if before is None or now is None or len(before) != len(now):
        return f"{name} {before} -> {now}" if name == "status" else f"{name} of other queries"
    pairs = [pair for pair in zip(before, now, strict=True) if not _is_equal(*pair)]
    apart = [abs(a - b) for a, b in pairs if isinstance(a, (int, float)) and isinstance(b, (int, float))]
    words = f", by at most {max(apart):.2g}" if apart else f", such as {pairs[0][0]} -> {pairs[0][1]}" if pairs else ""
    return f"{name} of {len(pairs)} of {len(now)}{words}" if pairs else ""


def _is_equal(a: Any, b: Any) -> bool:
    if isinstance(a, (int, float)) and isinstance(b, (int, float)):
        return math.isclose(a, b, rel_tol=TOLERANCE, abs_tol=TOLERANCE)
    return bool(a == b)


def summary(lines: Iterable[str], n_rows: int) -> str:
    """Return how many rows differ, and of which methods and scorers."""
    differing = [line.partition(": ")[0].split(", ") for line in lines]
    if not differing:
        return f"nothing differs in {n_rows} rows"
    names = [dict.fromkeys(row[place] for row in differing if len(row) > place) for place in (3, 4)]
    return f"{len(differing)} of {n_rows} rows differ; methods: {', '.join(names[0])}; scorers: {', '.join(names[1])}"


def main() -> int:
    """Make the reference, and compare it or accept it."""
    parser = argparse.ArgumentParser(prog="python -m tests.behaviour.reference", description=__doc__)
    parser.add_argument("--accept", action="store_true", help="write reference.json")
    parser.add_argument("-d", dest="sets", action="append", choices=ALL_SETS, help="of these sets alone")
    parser.add_argument("-m", dest="methods", action="append", default=[], help="of these methods alone")
    given = parser.parse_args()
    root = os.environ.get("CANONICAL_FORMS_DATA")
    sets = [name for name in given.sets or ALL_SETS if root or name != "tosca"]
    if given.accept and len(sets) < len(ALL_SETS):
        parser.error("--accept takes rows of all sets: set CANONICAL_FORMS_DATA, and drop -d")
    if not REFERENCE.exists() and (given.methods or not given.accept):
        parser.error(f"there is no {REFERENCE.name}: --accept without -m makes it")
    if not root:
        print("tosca is left out: CANONICAL_FORMS_DATA does not say where it is")
    start = time.monotonic()
    with TemporaryDirectory() as folder:
        now = make(Path(folder), Path(root) if root else None, sets, given.methods)
    print(f"made {len(now)} rows in {time.monotonic() - start:.0f} s")
    known: Rows = json.loads(REFERENCE.read_text(encoding="utf-8")) if REFERENCE.exists() else {}
    if given.accept:
        now |= {row: known[row] for row in known if not _is_made(row, sets, given.methods)}
        lines = (f"{json.dumps(row, ensure_ascii=False)}: {json.dumps(now[row])}" for row in sorted(now))
        REFERENCE.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")
        return 0
    known = {row: values for row, values in known.items() if _is_made(row, sets, given.methods)}
    differing = compare(known, now)
    print(*differing, summary(differing, len(now)), sep="\n")
    return 1 if differing else 0


def _is_made(row: str, sets: Sequence[str], methods: Sequence[str]) -> bool:
    """Return whether a row belongs to a selection."""
    part, gallery, *rest = row.split(", ")
    is_of_methods = not methods or (part == "every" and (not rest or rest[1] in methods))
    return is_of_methods and gallery.partition(" ")[0] in sets


if __name__ == "__main__":
    sys.exit(main())
