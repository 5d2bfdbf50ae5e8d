"""Records of older code under the keys of this code: the whole way, from the choice of records to the new files."""

from __future__ import annotations

import platform
import shutil
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from benchmark.errors import ConfigurationError
from benchmark.jobs.rekey.candidates import Candidate
from benchmark.jobs.rekey.changes import NEW, OLD, Change, changes
from benchmark.jobs.rekey.reached import Region
from benchmark.jobs.rekey.sampling import Row, sample_of
from benchmark.jobs.rekey.trees import Tree, ask, checked_out, working_tree
from benchmark.storage.environment import environment
from benchmark.storage.keys import digest
from benchmark.storage.records import Record, Records
from benchmark.storage.store import Store
from benchmark.system.arrays import load_arrays, save_arrays
from benchmark.system.files import write_atomically

#: Shapes of a sample, besides those that are refused.
SAMPLE = 3

#: Seconds after which a run without compiled kernels is ended.
_SMALL_LIMIT = 480.0

#: Rows that are made without compiled kernels for each module with kernels that differ.
_SMALL_ROWS = 6


@dataclass(frozen=True, kw_only=True)
class Scope:
    """Selection of records to move.

    Parameters
    ----------
    store
        The results folder; models that were trained there are used.
    records
        Its records, those made there or the published ones.
    only
        Names of which a record must have one: of its method, gallery, data set or input; none for all records.
    size
        Shapes of a sample.
    data_root, plugins
        As for a run.
    jobs
        Processes at a time.
    """

    store: Store
    records: Records
    only: tuple[str, ...] = ()
    size: int = SAMPLE
    data_root: Path | None = None
    plugins: tuple[Path, ...] = ()
    jobs: int = 1


@dataclass
class Outcome:
    """Counts of the records that moved and stayed.

    Parameters
    ----------
    candidates
        All of them, each with what speaks against it.
    unreached
        Changes that no sample has reached.
    reached
        Number of functions that differ and ran.
    moved
        Records under their new keys.
    """

    candidates: list[Candidate]
    unreached: list[Change] = field(default_factory=list)
    reached: int = 0
    moved: list[Record] = field(default_factory=list)

    @property
    def current(self) -> int:
        """Number of records that this code would make under the key that they have."""
        return sum(candidate.is_current for candidate in self.candidates)

    @property
    def refused(self) -> list[Candidate]:
        """Records that stay as they are though this code gives them another key."""
        return [candidate for candidate in self.candidates if candidate.problem and not candidate.is_current]


def rekey(commit: str, scope: Scope, say: Callable[[str], None], *, dry_run: bool = False) -> Outcome:
    """Give records of older code the keys of this code, where a sample of each comes out the same under both.

    Parameters
    ----------
    commit
        The commit whose code made the records.
    scope
        Which records, and what is needed to make samples of them.
    say
        Told how it goes, a line at a time.
    dry_run
        Whether to leave the records as they are.

    Raises
    ------
    ConfigurationError
        If there is no such commit or no such record, or a tree cannot make samples at all.
    """
    records = [record for record in scope.records if _is_asked(record, scope.only)]
    if not records:
        raise ConfigurationError(
            f"{scope.records.folder} holds no record with scores that is asked for", "correct --results or --only"
        )
    working = working_tree()
    folder = scope.store.root / "rekey"
    folder.mkdir(parents=True, exist_ok=True)
    say(f"checking out {commit}; {len(records)} records")
    with checked_out(commit, folder / "tree", working) as old:
        trees = (old, working)
        found = Outcome(_planned(records, scope, trees, folder, say))
        for candidate in found.candidates:
            if not candidate.is_current:
                candidate.check_recipes(old.name)
        found.candidates = _latest(found.candidates)
        to_compare = [each for each in found.candidates if not (each.is_current or each.problem)]
        if to_compare:
            _sample(found, to_compare, scope, trees, folder, say)
        if not dry_run:
            to_move = [candidate for candidate in to_compare if not candidate.problem]
            found.moved += [_move(candidate, scope, trees) for candidate in to_move]
            if scope.records == scope.store.published:
                scope.records.gather()
            scope.records.remove(*(candidate.record["key"] for candidate in to_move))
    if not (dry_run or found.refused):  # what was answered is of no more use
        shutil.rmtree(folder, ignore_errors=True)
    return found


def _is_asked(record: Mapping[str, Any], only: Iterable[str]) -> bool:
    data = record["data"]
    names = {
        record["method"], record["method"].partition("[")[0], record["gallery"], data["name"], data["source"],
        record["input"],
    }  # fmt: skip
    return record["status"] == "ok" and (not only or bool(names & set(only)))


def _planned(
    records: Sequence[Record], scope: Scope, trees: tuple[Tree, Tree], folder: Path, say: Callable[[str], None]
) -> list[Candidate]:
    """Ask both trees for the keys that they give to records."""
    request = _request(scope, [Row.of(record) for record in records], folder / "plans")
    answers = []
    for tree in trees:
        say(f"keys that {tree.name} gives")
        lines = _asked(tree, [request], folder, lambda done: None)
        by_row = {line["row"]: line for line in lines if "row" in line}
        answers.append([by_row[number] for number in range(len(records))])
    return [Candidate(record, *each) for record, *each in zip(records, *answers, strict=True)]


def _latest(candidates: Sequence[Candidate]) -> list[Candidate]:
    """Candidates without those whose place has a record that is current, or may move."""
    settled = {each.place for each in candidates if each.is_current or not each.problem}
    return [each for each in candidates if each.is_current or not each.problem or each.place not in settled]


def _request(scope: Scope, rows: Sequence[Row], store: Path, **further: Any) -> dict[str, Any]:
    return {
        "rows": [row.plain() for row in rows],
        "results": str(scope.store.root.parent.resolve()),
        "store": str(store.resolve()),
        "data_root": str(scope.data_root.resolve()) if scope.data_root else None,
        "plugins": [str(path.resolve()) for path in scope.plugins],
        **further,
    }


def _asked(
    tree: Tree, requests: Sequence[Mapping[str, Any]], folder: Path, watch: Callable[[int], None], **options: Any
) -> list[dict[str, Any]]:
    """Answers of a tree; the same requests of the same code are not answered again."""
    name = digest([list(requests), tree.digest(), options.get("variables", {})])[:12]
    return ask(tree, requests, folder / "answers" / name, watch, **options)


def _sample(
    found: Outcome, candidates: list[Candidate], scope: Scope, trees: tuple[Tree, Tree], folder: Path,
    say: Callable[[str], None],
) -> None:  # fmt: skip
    """Make the samples under both trees, and compare them."""
    differing = [
        change for change in changes(*trees) if any(change.module in each.modules(change.tree) for each in candidates)
    ]
    groups: dict[tuple[Any, ...], list[Candidate]] = {}
    for each in candidates:  # galleries of one data set share their samples
        row = Row.of(each.record)
        place = (row.source, row.input, row.method, row.scorer, row.seed, row.models, each.last, _trains(each))
        groups.setdefault(place, []).append(each)
    largest = [max(group, key=lambda each: each.record["n_shapes"]) for group in groups.values()]
    rows = [
        replace(Row.of(each.record), sample=sample_of(each.record, scope.size), last=each.last, train=_trains(each))
        for each in largest
    ]
    store = folder / "samples" / digest([[row.plain() for row in rows], [tree.digest() for tree in trees]])[:12]
    parts = _parts(rows, scope.jobs)
    lines: list[list[dict[str, Any]]] = []
    for number, tree in enumerate(trees):
        regions = _regions(change for change in differing if change.tree == number)
        requests = [_request(scope, [rows[row] for row in part], store, regions=regions) for part in parts]
        watch = _Progress(f"samples of {tree.name}", sum(len(row.sample) for row in rows), say)
        lines.append(_asked(tree, requests, folder, watch))
    answers = [{parts[line["request"]][line["row"]]: line for line in each if "row" in line} for each in lines]
    for number, group in enumerate(groups.values()):
        for candidate in group:
            candidate.compare(answers[OLD][number], answers[NEW][number], store / "runs")
    reached = [{name for line in each for name in line.get("reached", ())} for each in lines]
    unreached = [change for change in differing if change.name not in reached[change.tree]]
    open_rows = [each for each in candidates if not each.problem]
    compiled = [c for c in unreached if c.is_compiled and any(c.module in each.modules(c.tree) for each in open_rows)]
    if compiled:
        for number, tree in enumerate(trees):
            wanted = [change for change in compiled if change.tree == number]
            if wanted:
                small = _small_rows(wanted, largest, rows)
                request = _request(
                    scope, small, folder / "small" / str(number), regions=_regions(wanted), small=True,
                    meshes="" if any(row.last == "mesh" for row in small) else str(store),
                )  # fmt: skip
                total = sum(len(row.sample) for row in small)
                watch = _Progress(f"kernels of {tree.name}, not compiled", total, say)
                told = _asked(tree, [request], folder, watch, variables={"NUMBA_DISABLE_JIT": "1"}, limit=_SMALL_LIMIT)
                reached[number] |= {name for line in told for name in line.get("reached", ())}
        unreached = [change for change in differing if change.name not in reached[change.tree]]
    for candidate in candidates:
        candidate.check_coverage(unreached)
        candidate.changes = [c for c in differing if c.tree == NEW and c.module in candidate.modules(NEW)]
    found.unreached = unreached
    functions, missed = ({(c.module, c.function) for c in each if c.function} for each in (differing, unreached))
    found.reached = len(functions - missed)


def _trains(candidate: Candidate) -> bool:
    """Return whether the code that trains the models of a row differs."""
    return bool(candidate.old.get("training") != candidate.new.get("training"))


def _regions(wanted: Iterable[Change]) -> dict[str, dict[str, Region]]:
    found: dict[str, dict[str, Region]] = {}
    for change in wanted:
        found.setdefault(change.file, {})[change.name] = change.region
    return found


def _parts(rows: Sequence[Row], count: int) -> list[list[int]]:
    """Divide rows among processes; those of one data set and input stay together, the largest groups first."""
    groups: dict[tuple[str, str, int], list[int]] = {}
    for number, row in enumerate(rows):
        groups.setdefault((row.source, row.input, row.seed), []).append(number)
    parts: list[list[int]] = [[] for _ in range(count)]
    for group in sorted(groups.values(), key=len, reverse=True):
        min(parts, key=len).extend(group)
    return [part for part in parts if part]


def _small_rows(wanted: Iterable[Change], candidates: Sequence[Candidate], rows: Sequence[Row]) -> list[Row]:
    """Rows that can reach changes: for each module some of different methods, of the first data set that has them."""
    chosen: dict[int, Row] = {}
    for module, tree in {(change.module, change.tree): None for change in wanted}:
        methods: dict[tuple[str, str, str], int] = {}
        for number, candidate in enumerate(candidates):
            if module in candidate.modules(tree) and not candidate.problem:
                row = rows[number]
                methods.setdefault((row.method, row.input, row.scorer), number)
        chosen |= {number: rows[number] for number in list(methods.values())[:_SMALL_ROWS]}
    return list(chosen.values())


class _Progress:
    """Tells how far the samples of a tree are, every so many seconds."""

    def __init__(self, what: str, total: int, say: Callable[[str], None]) -> None:
        self._what, self._total, self._say = what, total, say
        self._begun = self._said = time.monotonic()
        say(f"{what}: {total} shapes")

    def __call__(self, done: int) -> None:
        now = time.monotonic()
        if now - self._said >= 10.0:
            self._said = now
            left = (now - self._begun) * (self._total - done) / done if done else None
            self._say(f"{self._what}: {done} of {self._total} shapes" + (f", about {left:.0f} s left" if left else ""))


def _move(candidate: Candidate, scope: Scope, trees: tuple[Tree, Tree]) -> Record:
    """Write a record under its new key, with its arrays where they are here."""
    old, new = dict(candidate.record), candidate.new
    note = {
        "key": old["key"],
        "from": trees[OLD].name,
        "to": trees[NEW].name,
        "shapes": list(candidate.shapes),
        "last_stage": candidate.last,
        "functions": sorted({f"{c.module}.{c.function}" for c in candidate.changes if c.function}),
        "date": datetime.now(UTC).date().isoformat(),
        "machine": f"{platform.machine()}, {environment().get('blas', '')}",
    }
    arrays = dict(zip(candidate.old["artefacts"], new["artefacts"], strict=False))
    for before, now in arrays.items():
        _copy(scope.store, before, now)
    made = old | {"key": new["key"], "recipe": new["recipe"], "rekeyed": [*old.get("rekeyed", ()), note]}
    made |= {"target": new["target"], "data": old["data"] | {"module": new["module"]}}
    if "artefacts" in old:
        made["artefacts"] = sorted(arrays.get(key, key) for key in old["artefacts"])
    scope.records.write(made)
    return made


def _copy(store: Store, before: str, now: str) -> None:
    """Keep arrays under another key as well, where they are here."""
    source, target = (store.artefacts / key[:2] / f"{key}.npz" for key in (before, now))
    if before == now or not before or not source.is_file() or target.is_file():
        return
    try:
        arrays = load_arrays(source, before)
    except Exception:  # damaged: it is made again when it is needed
        return
    write_atomically(target, lambda file: save_arrays(file, now, arrays, compressed=True))
