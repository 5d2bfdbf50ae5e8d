"""What was tried and what it crossed: as text, as JSON, and as the document of the latest try of each case."""

from __future__ import annotations

import json
import statistics
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmark.report.escaping import markdown_table
from benchmark.system.fingerprints import fingerprint
from tools.faults.cases import Border, Outcome

#: Where the latest report of each case is kept, and the document that is made of it.
REPORT, DOCUMENT = Path("results/faults.json"), Path("docs/appendix/faults.md")

#: Borders that have a column of their own.
_COLUMNS = (Border.LOST, Border.HALF, Border.ORPHAN, Border.STALL)

_HEADER = (
    "section", "cases", "tried", "crossed", "records lost", "half records", "orphans", "stalls",
    "recovery s, median", "max",
)  # fmt: skip

_TEXT = """\
# Faults made on purpose

After this page you can try the suite with kills, bad plugins, full disks and damaged files, and read what was found.
Written by `python -m tools.faults --publish`; do not edit.

    python -m tools.faults [--seed N] [--seconds S] [--kills N] [--only NAME] [--workers 1|2] [--output FILE]
    python -m tools.faults --publish --rest
    python -m tools.faults --list

tries the suite with faults of every kind, each made on the fly in a temporary folder from the seed, and asks of each:
no finished record lost or changed, no half record, no process that outlives its run, no command without an end, no
traceback for the user, no undocumented exit code, a word on what is wrong, and for everything that the fault does not
touch the scores of an undisturbed run. It ends with exit code 1 if any of these borders was crossed, and with the
command that tries the case again. `--seconds` mixes the sections and begins no further case after that time; a short
round is part of the tests, one of half a minute of the slow ones. It needs Linux.

- **kills**: KILL, TERM, HUP and INT to the harness, its session, its workers and the programs that methods run, five
  in a results folder, at ages of a worker from 0 to 4 s, half of them in the first second. Where the harness dies the
  same command is given again, with `--retry all`. Recovery is the time from a kill until some worker is at work again.
- **plugins**: plugin files that exit, crash, hang, fork, eat memory, answer nonsense, or name themselves oddly, when
  imported, made, or at work; in `run` beside a method that must keep its scores, and in `plan`, `list`, `check`,
  `canonicalise`, `report` and `why`. A file that cannot be used at all is refused in one line before any work begins.
- **folders**: bad shapes among good ones, which must be ranked; folders that cannot be used, which are refused in one
  line.
- **disks**: limits on the size of files, small disks, results folders that cannot be written or go away, two runs in
  one folder, a standard output that is full or closed.
- **damage**: records and artefacts with changed bits and digits, cut off, doubled, replaced; alien files beside them.
- **arguments**: command lines of every verb with values that nobody would give; a usage error is one line.
- **readers**: mesh files of every format with random damage.

Commands are forked from a process that has imported the suite already, and read its sources, for that takes longer than
most of them; workers start as always.

## Found by hand

Each was wrong once and has a test:

- a method that leaves a timer, a handler or `faulthandler` armed: all is cleared before the next method of its file;
  one that leaves threads or children keeps its process for itself (`tests/system/test_services.py`);
- a crash in a process that others used: the job is tried once more alone (`tests/jobs/test_workers_that_die.py`);
- a method that replaces `isinstance`, `ulimit -f`, `PYTHONWARNINGS=error` (`tests/system/test_workers.py`);
- `merge` killed or terminated; a leftover whose writer's number another process has (`tests/storage/test_merging.py`,
  `tests/system/test_files.py`);
- one mesh of 655 362 vertices among eight small ones: begun first, and named while it is waited for
  (`tests/jobs/test_executors.py`, `tests/cli/test_progress.py`);
- a user who is not root, without a home that can be written, or with a folder of records that cannot be read
  (`tests/system/test_kernel_cache.py`, `tests/storage/test_records.py`);
- a `report` that was killed before its first page stood in the way of the next (`tests/report/html/test_site.py`);
- a `rekey` killed while it samples, whose samples went on (`tests/jobs/rekey/test_trees.py`); killed `gather` and
  `rekey` left temporary files that neither cleared (`tests/storage/test_gathering.py`);
- a dask worker whose suite takes other tasks: it failed at each and ended the run without a reason; one of another
  version of distributed is named in one line (`tests/jobs/cluster/test_dask.py`).

Tried and as it should be: `gather`, `merge --published` and the removal of records killed before each file that they
replace or remove, `rekey` before each of the first four, all given again; `gather` beside a `run`, which is refused;
`tables` three times while another process gathered 11 times; one of two dask workers killed, both killed and another
one started, a worker of distributed 2025.5.1, which works, and one of 2023.3.0, which never registers; `prune` killed
between two files; 3000 meshes of four vertices; NPZ files that unfold to 12
GB, claim 200 000 x 200 000 numbers, hold pickles or 50 000 arrays, as depth images and as artefacts.

## Latest report

The latest try of each case. `--publish` keeps each as soon as it has ended, and with `--rest` a program that was
stopped goes on where it was; the report says whether it was the same code all the time. The seed, the seconds and the
code of each case are in [results/faults.json](../../results/faults.json).

"""


def code() -> str:
    """Short digest of what is tried: the code of the command line and the versions of its packages."""
    return fingerprint("benchmark.cli.main", "baselines.surface_area", "baselines.identity").digest[:8]


def as_json(outcomes: Sequence[Outcome], seed: int, seconds: float, code: str) -> dict[str, Any]:
    """All that was tried, by the names of the cases."""
    return {
        "seed": seed,
        "seconds": round(seconds, 1),
        "cases": {outcome.name: _figures(outcome, seed, code) for outcome in outcomes},
    }


def as_text(report: Mapping[str, Any]) -> str:
    """A table in Markdown, and below it each crossing with the command that makes it again."""
    text = table(report["cases"]) + f"\nSeed {report['seed']}, {report['seconds']:.0f} s.\n"
    for name, figures in report["cases"].items():
        for crossing in figures["crossings"]:
            text += f"\n{name}: {Border[crossing['border']]}\n    {crossing['said']}\n    {_again(name, figures)}\n"
    return text


def table(cases: Mapping[str, Mapping[str, Any]]) -> str:
    """One row a section, and one for all."""
    sections = dict.fromkeys(name.partition("/")[0] for name in cases)
    rows: list[Sequence[str]] = []
    for section in sections:
        own = [figures for name, figures in cases.items() if name.startswith(f"{section}/")]
        rows.append((section, *_cells(own)))
    rows.append(("all", *_cells(list(cases.values()))))
    return "\n".join(markdown_table(_HEADER, rows)) + "\n"


def publish(report: Mapping[str, Any], root: Path = Path()) -> None:
    """Put the cases of a report into the kept one, in place of their former figures, and write the document."""
    path = root / REPORT
    kept = json.loads(path.read_text()) if path.exists() else {}
    kept = dict(sorted((kept | report["cases"]).items()))
    lines = (f"{json.dumps(name)}: {json.dumps(figures)}" for name, figures in kept.items())
    path.write_text("{\n" + ",\n".join(lines) + "\n}\n")
    (root / DOCUMENT).write_text(document(kept))


def published(seed: int, code: str, root: Path = Path()) -> set[str]:
    """Names of the cases that the kept report has of a seed and a code, and in which no border was crossed."""
    path = root / REPORT
    kept = json.loads(path.read_text()) if path.exists() else {}
    return {
        name
        for name, figures in kept.items()
        if (figures["seed"], figures["code"]) == (seed, code) and not figures["crossings"]
    }


def document(cases: Mapping[str, Mapping[str, Any]]) -> str:
    """The whole document."""
    crossed = [
        f"\n`{name}`: {Border[crossing['border']]}; `{_again(name, figures)}`.\n"
        for name, figures in cases.items()
        for crossing in figures["crossings"]
    ]
    return _TEXT + table(cases) + _codes(cases) + "".join(crossed)


def _codes(cases: Mapping[str, Mapping[str, Any]]) -> str:
    """Which code the cases were tried with: one, unless it changed between the parts of the report."""
    counts = Counter(figures["code"] for figures in cases.values())
    told = ", ".join(f"`{code}` ({count} of {len(cases)} cases)" for code, count in counts.most_common())
    return f"\nCode that was tried, as a digest of its modules and packages: {told}.\n"


def _figures(outcome: Outcome, seed: int, code: str) -> dict[str, Any]:
    return {
        "seed": seed,
        "code": code,
        "tried": outcome.tried,
        "seconds": round(outcome.seconds, 1),
        "recoveries": [round(seconds, 2) for seconds in outcome.recoveries],
        "crossings": [{"border": crossing.border.name, "said": crossing.said} for crossing in outcome.crossings],
    }


def _again(name: str, figures: Mapping[str, Any]) -> str:
    return f"python -m tools.faults --only {name} --seed {figures['seed']}"


def _cells(cases: Sequence[Mapping[str, Any]]) -> list[str]:
    borders = [Border[crossing["border"]] for figures in cases for crossing in figures["crossings"]]
    recoveries = [seconds for figures in cases for seconds in figures["recoveries"]]
    counts = [len(cases), sum(figures["tried"] for figures in cases), len(borders)]
    counts += [borders.count(border) for border in _COLUMNS]
    times = [statistics.median(recoveries), max(recoveries)] if recoveries else []
    return [str(count) for count in counts] + ([f"{seconds:.1f}" for seconds in times] or ["", ""])
