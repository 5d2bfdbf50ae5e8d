"""What was tried and what it crossed: as text, as JSON, and as the document of the latest run of each section."""

from __future__ import annotations

import json
import statistics
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from tests.faults.cases import Border, Outcome

#: Where the latest report of each section is kept, and the document that is made of it.
REPORT, DOCUMENT = Path("results/faults.json"), Path("docs/faults.md")

#: Borders that have a column of their own.
_COLUMNS = (Border.LOST, Border.HALF, Border.ORPHAN, Border.STALL)

_HEADER = (
    "section", "cases", "tried", "crossed", "records lost", "half records", "orphans", "stalls",
    "recovery s, median", "max",
)  # fmt: skip

_TEXT = """\
# Faults made on purpose

Written by `python -m tests.faults --publish`; do not edit.

    python -m tests.faults [--seed N] [--seconds S] [--kills N] [--only NAME] [--workers 1|2] [--output FILE]
    python -m tests.faults --list

tries the suite with faults of every kind, each made on the fly in a temporary folder from the seed, and asks of each:
no finished record lost or changed, no half record, no process that outlives its run, no command without an end, no
traceback for the user, no undocumented exit code, a word on what is wrong, and for everything that the fault does not
touch the scores of an undisturbed run. It ends with exit code 1 if any of these borders was crossed, and with the
command that tries the case again. `--seconds` mixes the sections and begins no further case after that time; a short
round is part of the tests, one of three minutes of the slow ones. It needs Linux.

- **kills**: KILL, TERM, HUP and INT to the harness, its session, its workers and the programs that methods run, five in
  a results folder, at ages of a worker from 0 to 4 s, half of them in the first second. Where the harness dies the same
  command is given again, with `--retry all`. Recovery is the time from a kill until some worker is at work again.
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

Commands are forked from a process that has imported the suite already, for importing takes longer than most of them;
workers start as always.

## Latest report of each section

"""


def as_json(outcomes: Sequence[Outcome], seed: int, seconds: float) -> dict[str, Any]:
    """All figures and all crossings, by section."""
    sections = dict.fromkeys(outcome.section for outcome in outcomes)
    return {
        "seed": seed,
        "seconds": round(seconds, 1),
        "sections": {
            name: _figures([outcome for outcome in outcomes if outcome.section == name], seed) for name in sections
        },
    }


def as_text(report: Mapping[str, Any]) -> str:
    """A table in Markdown, and below it each crossing with the command that makes it again."""
    text = table(report["sections"]) + f"\nSeed {report['seed']}, {report['seconds']:.0f} s.\n"
    for figures in report["sections"].values():
        for crossing in figures["crossings"]:
            text += (
                f"\n{crossing['case']}: {Border[crossing['border']]}\n    {crossing['said']}\n    {crossing['again']}\n"
            )
    return text


def table(sections: Mapping[str, Mapping[str, Any]]) -> str:
    """One row a section, and one for all."""
    lines: list[Sequence[str]] = [_HEADER, ("---", *["---:"] * (len(_HEADER) - 1))]
    lines += [(name, *_cells([figures])) for name, figures in sections.items()]
    lines.append(("all", *_cells(sections.values())))
    return "".join(f"| {' | '.join(cells)} |\n" for cells in lines)


def publish(report: Mapping[str, Any], root: Path = Path()) -> None:
    """Put the sections of a report into the kept one, in place of their former figures, and write the document."""
    path = root / REPORT
    kept = json.loads(path.read_text()) if path.exists() else {}
    kept |= report["sections"]
    path.write_text(json.dumps(kept, indent=1) + "\n")
    (root / DOCUMENT).write_text(document(kept))


def document(sections: Mapping[str, Mapping[str, Any]]) -> str:
    """The whole document."""
    seeds = ", ".join(f"{name} {figures['seed']}" for name, figures in sections.items())
    text = _TEXT + table(sections) + f"\nSeeds: {seeds}.\n"
    crossed = [crossing for figures in sections.values() for crossing in figures["crossings"]]
    return text + "".join(f"\n`{each['case']}`: {Border[each['border']]}.\n" for each in crossed)


def _figures(outcomes: Sequence[Outcome], seed: int) -> dict[str, Any]:
    return {
        "seed": seed,
        "cases": len(outcomes),
        "tried": sum(outcome.tried for outcome in outcomes),
        "seconds": round(sum(outcome.seconds for outcome in outcomes), 1),
        "recoveries": [round(seconds, 2) for outcome in outcomes for seconds in outcome.recoveries],
        "crossings": [
            {
                "case": outcome.name, "border": crossing.border.name, "said": crossing.said,
                "again": f"python -m tests.faults --only {outcome.name} --seed {seed}",
            }
            for outcome in outcomes
            for crossing in outcome.crossings
        ],
    }  # fmt: skip


def _cells(parts: Iterable[Mapping[str, Any]]) -> list[str]:
    found = list(parts)
    borders = [Border[crossing["border"]] for figures in found for crossing in figures["crossings"]]
    recoveries = [seconds for figures in found for seconds in figures["recoveries"]]
    counts = [sum(figures[name] for figures in found) for name in ("cases", "tried")]
    counts += [len(borders), *(borders.count(border) for border in _COLUMNS)]
    times = [statistics.median(recoveries), max(recoveries)] if recoveries else []
    return [str(count) for count in counts] + ([f"{seconds:.1f}" for seconds in times] or ["", ""])
