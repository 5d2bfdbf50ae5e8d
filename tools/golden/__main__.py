"""``make golden``: make the golden results of all components again, and compare.

Where all agree, the digests of code in ``versions.lock`` are those of today. Where not, each component that moved is
named, and nothing is written but what ``--accept`` names.
"""

from __future__ import annotations

import argparse
import multiprocessing
import sys
import time
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor, as_completed

from benchmark.storage.lock import Component, write_lock
from benchmark.threads import pin_threads
from tools.golden.components import components, folders_of
from tools.golden.results import Arrays, Difference, compare, read_golden, timed, version_of, write_golden

PROCESSES = 2
#: Components that are printed as the slowest.
SLOWEST = 5
#: They take longest, so they begin.
FIRST = ("scorer/cm-bof", "method/learned", "data/humans-scanlike", "data/camera", "method/skeleton", "method/")


def main(arguments: list[str] | None = None) -> int:
    """Return 0 where all components agree, or those that do not were accepted."""
    parser = argparse.ArgumentParser(prog="make golden", description=__doc__)
    parser.add_argument("--accept", nargs="+", default=[], metavar="NAME", help="write these golden files; all: all")
    parser.add_argument("--only", nargs="+", default=[], metavar="NAME", help="run these components alone")
    parser.add_argument("--coverage", action="store_true", help="list the lines that no golden input runs")
    chosen = parser.parse_args(arguments)
    names = [name for name in components() if not chosen.only or name in chosen.only]
    unknown = {*chosen.accept, *chosen.only} - components().keys() - {"all"}
    if unknown:
        parser.error(f"unknown component {sorted(unknown)[0]}; there are {', '.join(components())}")
    if chosen.coverage:
        from tools.golden.coverage import report

        return report(names)
    accepted = set(components()) if "all" in chosen.accept else set(chosen.accept)
    refused = [name for name, arrays, moved in _run(names) if not _settled(name, arrays, moved, accepted)]
    if refused:
        print(f"{len(refused)} components moved; where they should: make golden ARGS='--accept {' '.join(refused)}'")
    if not refused and not chosen.only:
        write_lock({name: Component(version_of(read_golden(name)), folders_of(name)) for name in components()})
    elif accepted:
        print("accepted files are written; versions.lock follows when all agree")
    return int(bool(refused))


def _settled(name: str, arrays: Arrays, moved: list[Difference], accepted: set[str]) -> bool:
    """Say how far a component moved; write its file where that is accepted."""
    if not moved:
        return True
    array, difference, tolerance = moved[0]
    state = "is new" if not read_golden(name) else f"moved by {difference:.1e} in {array} (tolerance {tolerance:g})"
    more = f", and {len(moved) - 1} more arrays" if len(moved) > 1 else ""
    print(f"{name} {state}{more}{': accepted' if name in accepted and arrays else ''}", flush=True)
    if name in accepted and arrays:
        write_golden(name, arrays)
        return True
    return False


def _run(names: Iterable[str]) -> Iterable[tuple[str, Arrays, list[Difference]]]:
    """Results of components with their differences, in the order in which they are ready."""
    pin_threads()
    start, seconds = time.perf_counter(), {}
    order = sorted(
        names, key=lambda name: next((n for n, first in enumerate(FIRST) if name.startswith(first)), len(FIRST))
    )
    with ProcessPoolExecutor(PROCESSES, multiprocessing.get_context("spawn")) as pool:
        for future in as_completed([pool.submit(timed, name) for name in order]):
            name, arrays, problem, seconds[name] = future.result()
            if problem:
                print(problem, file=sys.stderr)
            yield name, arrays, compare(name, arrays)
    slowest = sorted(seconds, key=lambda name: -seconds[name])[:SLOWEST]
    print(
        f"{len(seconds)} components in {time.perf_counter() - start:.0f} s; slowest: "
        + ", ".join(f"{name} {seconds[name]:.0f} s" for name in slowest)
    )


if __name__ == "__main__":
    sys.exit(main())
