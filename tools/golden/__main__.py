"""``make golden``: make the golden results of all components again, and compare.

Where all agree, the digests of code in ``versions.lock`` are those of today. Where not, each component that moved is
named, and nothing is written but what ``--accept`` names.
"""

from __future__ import annotations

import argparse
import multiprocessing
import sys
import time
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed

from benchmark.errors import ConfigurationError
from benchmark.kernels import drop_stale_kernels
from benchmark.machine import pin_threads
from benchmark.pipeline.storage.lock import Component, edited, read_lock, write_lock
from tools.golden.components import components, folders_of
from tools.golden.results import (
    Arrays,
    Difference,
    compare,
    golden_path,
    read_golden,
    results_of,
    version_of,
    write_golden,
)

PROCESSES = 2
#: Prefixes of the slowest components, which start first.
FIRST = ("data/animals", "data/humans-scanlike", "scorer/cm-bof", "method/learned", "data/", "method/")


def main(arguments: list[str] | None = None) -> int:
    """Return 0 if all components agree or the others were accepted."""
    parser = argparse.ArgumentParser(prog="make golden", description=__doc__)
    parser.add_argument("--accept", nargs="+", default=[], metavar="NAME", help="write these golden files; all: all")
    parser.add_argument("--only", nargs="+", metavar="NAME", help="run these; edited: those whose code was edited")
    chosen = parser.parse_args(arguments)
    only = list(components()) if chosen.only is None else chosen.only
    names = sorted({*only, *(unchecked() if "edited" in only else [])} - {"edited"})
    if unknown := {*names, *chosen.accept} - {*components(), "all"}:
        parser.error(f"unknown component {min(unknown)}; there are {', '.join(components())}")
    moved = [
        name for name, arrays, differences in _run(names) if not _settled(name, arrays, differences, chosen.accept)
    ]
    if moved:
        print(f"{len(moved)} components moved; where they should: make golden ARGS='--accept {' '.join(moved)}'")
    elif others := [name for name in unchecked() if name not in names]:
        print(f"versions.lock follows when these were run, too: {', '.join(others)}")
    else:
        write_lock({name: Component(version_of(read_golden(name)), folders_of(name)) for name in components()})
    return int(bool(moved))


def unchecked() -> list[str]:
    """Return components without golden results, and those whose code differs from the code that computed them."""
    try:
        known = read_lock().components
    except ConfigurationError:  # for example a merge conflict
        return list(components())
    return [name for name in components() if name not in known or not golden_path(name).exists() or edited([name])]


def _settled(name: str, arrays: Arrays, moved: list[Difference], accepted: list[str]) -> bool:
    """Report how much a component changed; write its file if accepted."""
    if not moved:
        return True
    array, difference, tolerance = moved[0]
    state = "is new" if not read_golden(name) else f"moved by {difference:.1e} in {array} (tolerance {tolerance:g})"
    more = f", and {len(moved) - 1} more arrays" if len(moved) > 1 else ""
    is_accepted = bool(arrays) and not {name, "all"}.isdisjoint(accepted)
    print(f"{name} {state}{more}{': accepted' if is_accepted else ''}", flush=True)
    if is_accepted:
        write_golden(name, arrays)
    return is_accepted


def _run(names: Iterable[str]) -> Iterator[tuple[str, Arrays, list[Difference]]]:
    """Yield the results of components with their differences, in order of completion."""
    pin_threads()
    drop_stale_kernels()
    start = time.perf_counter()
    places = {name: [name.startswith(first) for first in (*FIRST, "")].index(True) for name in names}
    with ProcessPoolExecutor(PROCESSES, multiprocessing.get_context("spawn")) as pool:
        for future in as_completed([pool.submit(results_of, name) for name in sorted(places, key=places.__getitem__)]):
            name, arrays, problem = future.result()
            if problem:
                print(problem, file=sys.stderr)
            yield name, arrays, compare(name, arrays)
    print(f"{len(places)} components in {time.perf_counter() - start:.0f} s")


if __name__ == "__main__":
    sys.exit(main())
