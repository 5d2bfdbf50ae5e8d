"""Growth of runs: ``python -m tools.speed.scale --sizes 100,1000 --ranking 4000 --neighbours 100000 --records 10000``.

Writes docs/appendix/scale.md and its figure. What was measured is kept in results/scale.json, so that sizes, and with
``--input`` complete surfaces and views of a size, can be measured one at a time, a run that was stopped goes on, and
``--write`` alone makes the page anew.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import psutil

from benchmark.protocols.tables import INPUTS
from benchmark.system.files import write_text
from retrieval.clock_index import ClockIndex
from retrieval.neighbours import Nearest
from tools.speed._scale_page import METHODS, POSES, ROOT, write

MEASURED = ROOT / "results" / "scale.json"
CORES = 2
#: Work after which a job is stopped: one of 10 000 complete surfaces takes longer than the usual limit.
LONGEST = "86400s"
MIB = 2**20
#: Between two looks at the disk, of which each goes through all files.
SECONDS_BETWEEN_LOOKS = 30.0
#: Neighbours that are looked for; the share that was found is measured on some queries, against all shapes.
K = 20
#: Shapes beyond which the neighbours of so many are looked for, and the seconds multiplied.
MOST_SHAPES, SOME_SHAPES = 20_000, 2000


def gallery(size: int) -> str:
    """Name of the data set of so many shapes."""
    return f"humans[subjects={size // POSES},poses={POSES}]"


def command(verb: str, size: int, results: Path, *more: str) -> list[str]:
    """A verb on a gallery."""
    methods = [word for name in METHODS for word in ("-m", name)]
    return [sys.executable, "-m", "benchmark", verb, "-d", gallery(size), *methods, "--results", str(results), *more]


def run(size: int, folder: Path, input_: str = "") -> dict[str, Any]:
    """Run a gallery from nothing, or go on where it was stopped, and look at memory and disk meanwhile."""
    name, more = (f"{size}-{input_}", ("--input", input_)) if input_ else (str(size), ())
    results = folder / name
    spent = folder / f"{name}.json"  # of the runs that were stopped
    folder.mkdir(parents=True, exist_ok=True)
    before = {"run_seconds": 0.0, "peak_mib": 0.0, "most_disk_mib": 0.0}
    if spent.exists():
        before = json.loads(spent.read_text())
    begun = looked = time.perf_counter()
    process = subprocess.Popen(
        command("run", size, results, "-j", str(CORES), "--timeout", LONGEST, "--retry", "timeout", *more),
        cwd=ROOT,
        stdout=subprocess.DEVNULL,
    )
    found = dict(before)
    while process.poll() is None:
        found["peak_mib"] = max(found["peak_mib"], _resident(process.pid) / MIB)
        if time.perf_counter() - looked > SECONDS_BETWEEN_LOOKS:
            found["most_disk_mib"], looked = max(found["most_disk_mib"], _disk_mib(results)), time.perf_counter()
        time.sleep(0.5)
        found["run_seconds"] = before["run_seconds"] + time.perf_counter() - begun
        write_text(spent, json.dumps(found))
    if process.returncode not in (0, 1):
        raise SystemExit(f"the run of {size} shapes ended with {process.returncode}")
    records = [json.loads(path.read_text()) for path in (results / "runs" / "records").glob("*.json")]
    if stopped := [record for record in records if record["status"] not in ("ok", "unsupported")]:
        raise SystemExit(f"{stopped[0]['method']} of {size} shapes: {stopped[0]['reason']}")
    done = [record for record in records if record["status"] == "ok"]
    disk = _disk_mib(results)
    return {
        **found,
        "ranking_seconds": sum(record["wall_seconds"] for record in done),
        "disk_mib": disk,
        "most_disk_mib": max(found["most_disk_mib"], disk),
        "plan_seconds": _seconds(command("plan", size, results, *more)),
        "tables_seconds": _seconds(command("tables", size, results, *more)),
        "stages": {f"{r['input']} {r['method']}": r["cost"]["seconds_per_shape"] for r in done},
    }


def run_in_parts(size: int, folder: Path, input_: str) -> dict[str, Any]:
    """Run a gallery, or under one input: the whole is there when the other input has been measured, too."""
    if not input_:
        return run(size, folder)
    parts = _measured().get(str(size), {}).get("parts", {})
    if input_ not in parts:
        parts |= {input_: run(size, folder, input_)}
    if set(parts) < set(INPUTS):
        return {"parts": parts}
    sums = {name: sum(part[name] for part in parts.values()) for name in ("run_seconds", "ranking_seconds", "disk_mib")}
    most = {name: max(part[name] for part in parts.values()) for name in ("peak_mib", "most_disk_mib")}
    stages = {job: found for part in parts.values() for job, found in part["stages"].items()}
    return {"parts": parts, **sums, **most, "stages": stages}


def ranking(size: int) -> dict[str, Any]:
    """Match made-up signatures as numerous as real ones, keep the distances and score them, in this process."""
    from benchmark.jobs.stages.measures import scores
    from benchmark.storage.records import as_text
    from benchmark.storage.store import Store
    from retrieval.cmbof import CMBOF
    from tests.records import record
    from tools.speed import clock_matching

    # As many different forms would take long to draw; which ones are equal changes neither time nor memory.
    drawn = clock_matching.gallery(min(size, 200))
    forms = [drawn[k % len(drawn)] for k in range(size)]
    CMBOF().distances(forms[:10])  # compiles
    labels = [f"body-{k // POSES}" for k in range(size)]
    begun = time.perf_counter()
    matrix = CMBOF().distances(forms)
    matched = time.perf_counter()
    with TemporaryDirectory() as folder:
        Store.open(Path(folder)).get_or_compute({}, lambda: {"distances": matrix})
    begun_scoring = time.perf_counter()
    found = scores([matrix], labels)
    ended = time.perf_counter()
    made = record("identity") | found | {"labels": labels, "shapes": [f"{label}_standing-1" for label in labels]}
    return {
        "matching_seconds": matched - begun,
        "measures_seconds": ended - begun_scoring,
        "ranking_peak_mib": _peak_mib(),
        "record_mib": len(as_text(made)) / MIB,
    }


def neighbours(size: int) -> dict[str, Any]:
    """Index made-up signatures, find the neighbours of each, and compare them with the exact ones of some queries."""
    from benchmark.storage.store import Store
    from retrieval.neighbours import among_candidates, nearest
    from tools.speed.made_up_gallery import N_WORDS, signatures

    codebook = np.zeros((N_WORDS, 128), dtype=np.uint8)
    nearest(ClockIndex.counted(codebook, signatures(POSES, POSES)), 1)  # compiles
    drawing = _processor_seconds(lambda: sum(len(form.words) for form in signatures(size, POSES)))
    begun = time.process_time()
    index = ClockIndex.counted(codebook, signatures(size, POSES))
    indexed = time.process_time()
    some = range(size if size <= MOST_SHAPES else SOME_SHAPES)
    index.closeness(slice(0, 1))  # makes the vectors
    vectors = time.process_time()
    found = nearest(index, K) if len(some) == size else among_candidates(index, K, some)
    ended = time.process_time()
    with TemporaryDirectory() as folder:
        store = Store.open(Path(folder))
        store.get_or_compute({"stage": "index"}, index.to_arrays)
        if isinstance(found, Nearest):
            store.get_or_compute({"stage": "neighbours"}, found.to_arrays)
        disk = sum(path.stat().st_size for path in store.artefact_files()) / MIB
    peak = _peak_mib()
    shares = [_recall(index, found, int(query)) for query in _queries(len(some), size)]
    return {
        "index_seconds": max(indexed - begun - drawing, 0.0) + vectors - indexed,
        "nearest_seconds": (ended - vectors) * size / len(some),
        "nearest_peak_mib": peak,
        "nearest_disk_mib": disk,
        "recall_1": float(np.mean([first for first, _ in shares])),
        "recall_k": float(np.mean([first_k for _, first_k in shares])),
    }


def _queries(among: int, size: int) -> np.ndarray:
    """Some queries whose exact neighbours are looked for: about a million pairs, of 20 to 200 queries."""
    return np.random.default_rng(1).choice(among, min(among, max(20, min(200, 10**6 // size))), replace=False)


def _recall(index: ClockIndex, found: Any, query: int) -> tuple[float, float]:
    """Share of the nearest form, and of the K nearest, of a query that was found; any of those that tie will do."""
    others = np.delete(np.arange(len(index)), query)
    exact = np.sort(index.distances(np.full(len(others), query), others))
    distances = found.of(query)[1] if isinstance(found, Nearest) else np.sort(found[2][found[0] == query])
    return float(distances[0] <= exact[0]), float((distances[:K] <= exact[K - 1]).sum() / K)


def _processor_seconds(work: Callable[[], object]) -> float:
    begun = time.process_time()
    work()
    return time.process_time() - begun


def _peak_mib() -> float:
    status = dict(line.split(":", 1) for line in Path("/proc/self/status").read_text().splitlines())
    return int(status["VmHWM"].split()[0]) / 1024


def bookkeeping(size: int, folder: Path) -> dict[str, Any]:
    """Plan a gallery and make its tables, from made-up records as large as real ones."""
    from benchmark.jobs.plan import make_plan
    from benchmark.methods.registry import methods, select
    from benchmark.protocols.galleries import galleries
    from benchmark.storage.keys import plain
    from benchmark.storage.store import Store
    from retrieval.chance import chance_levels
    from retrieval.measures import MEASURES
    from tests.records import record

    results = folder / f"{size}-made-up"
    store = Store.open(results)
    rng = np.random.default_rng(0)
    for job in make_plan(galleries((), [gallery(size)]), INPUTS, select(METHODS, methods()), store):
        if job.to_run:
            entries = job.gallery.entries
            labels = [entry.subject for entry in entries]
            found = record(
                input_=job.input, shapes=[entry.identifier for entry in entries], labels=labels, n_shapes=len(entries),
                n_classes=len(set(labels)), chance=chance_levels(labels),
                scores={measure.name: 0.5 for measure in MEASURES},
                per_query={measure.name: rng.random(len(entries)).round(6).tolist() for measure in MEASURES},
            )  # fmt: skip
            store.write_record(found | job.facts | {"key": job.key, "recipe": plain(job.recipe)})
    return {
        "plan_seconds": _seconds(command("plan", size, results)),
        "tables_seconds": _seconds(command("tables", size, results)),
    }


def _seconds(words: list[str]) -> float:
    begun = time.perf_counter()
    subprocess.run(words, cwd=ROOT, stdout=subprocess.DEVNULL, check=True)
    return time.perf_counter() - begun


def _disk_mib(folder: Path) -> float:
    """Size of all files below a folder, from which others may take some away meanwhile."""
    total = 0
    for parent, _, names in os.walk(folder):
        for name in names:
            with suppress(FileNotFoundError):
                total += (Path(parent) / name).stat().st_size
    return total / MIB


def _resident(pid: int) -> int:
    total = 0
    try:
        parent = psutil.Process(pid)
        for process in (parent, *parent.children(recursive=True)):
            total += process.memory_info().rss
    except psutil.Error:
        return total
    return total


def _measured() -> dict[str, dict[str, Any]]:
    """Return what was measured, by size and quantity."""
    return dict(json.loads(MEASURED.read_text())) if MEASURED.exists() else {}


def main() -> None:
    """Measure what is asked for and not yet known, then write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sizes", default="", help="sizes to run, such as 100,1000")
    parser.add_argument("--input", choices=INPUTS, default="", help="run the sizes under this input alone, now")
    parser.add_argument("--ranking", default="", help="sizes of the ranking alone")
    parser.add_argument("--neighbours", default="", help="sizes of the neighbours alone")
    parser.add_argument("--records", default="", help="sizes of plan and tables alone")
    parser.add_argument("--results", type=Path, default=ROOT / "build" / "scale", help="where the runs are kept")
    parser.add_argument("--write", action="store_true", help="only make the page anew")
    parser.add_argument("--one", nargs=2, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one:
        work, size = options.one
        print(json.dumps({"ranking": ranking, "neighbours": neighbours}[work](int(size))))
        return
    measured = _measured()
    for text, name, work in (
        (options.sizes, "run_seconds", lambda size: run_in_parts(size, options.results, options.input)),
        (options.ranking, "matching_seconds", lambda size: _apart("ranking", size)),
        (options.neighbours, "nearest_seconds", lambda size: _apart("neighbours", size)),
        (options.records, "tables_seconds", lambda size: bookkeeping(size, options.results)),
    ):
        for size in [int(word) for word in text.split(",") if word and not options.write]:
            if name not in measured.get(str(size), {}):
                print(f"{size} shapes ...", flush=True)
                found = work(size)
                measured = _measured()  # others may have written
                measured[str(size)] = measured.get(str(size), {}) | found
                MEASURED.write_text(json.dumps(measured, indent=1, sort_keys=True) + "\n")
    write(measured)


def _apart(work: str, size: int) -> dict[str, Any]:
    """A measurement in a process of its own, whose memory is its alone."""
    words = [sys.executable, "-m", "tools.speed.scale", "--one", work, str(size)]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=True)
    return dict(json.loads(done.stdout))


if __name__ == "__main__":
    main()
