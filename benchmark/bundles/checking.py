"""Verification of a bundle: its scores are computed again from what it holds, and compared with what it says."""

from __future__ import annotations

import hashlib
import secrets
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmark.bundles.archive import Archive
from benchmark.bundles.known import Known
from benchmark.bundles.manifest import LONGEST, MANIFEST, BundleError, Entry, Manifest, manifest_of
from benchmark.bundles.outcome import Fault, Outcome, RowOutcome, claim, lie
from benchmark.bundles.remaking import Remade, Remaking, made_again
from benchmark.bundles.rows import RowCheck
from benchmark.errors import BenchmarkError
from benchmark.execution.processes.calls import BrokenCall, Guard, call_apart
from benchmark.pipeline.storage.record_schema import fault_of
from benchmark.pipeline.storage.records import Record, answered_shapes, scorer_name
from benchmark.plugins.parameters import split_name
from benchmark.plugins.registry import BUILT_IN
from benchmark.report.significance import intervals, queries_of
from benchmark.source_code import digest_of_source
from benchmark.text import is_name
from retrieval.measures import PRINTED

#: Forms of a record that are made again, at least.
FEWEST_AGAIN = 3

_ASK = "ask its author"


@dataclass(frozen=True)
class Request:
    """Request to verify a bundle.

    Parameters
    ----------
    path
        The bundle.
    known
        What it is compared with.
    run
        Whether the plug-in of the bundle may be run.
    n_again
        Forms of each record to make again.
    limit
        Seconds that each step may take.
    """

    path: Path
    known: Known
    run: bool = False
    n_again: int = FEWEST_AGAIN
    limit: float | None = None


def verify(request: Request, say: Callable[[str], None] = lambda line: None) -> Outcome:
    """Return what a bundle is; it is read and computed again in a process of its own, which it may crash.

    Raises
    ------
    BenchmarkError
        If the file cannot be read at all.
    """
    if not request.path.is_file():
        raise BenchmarkError(f"{request.path} is no file", "name a bundle that 'submit' wrote")
    patience = request.limit and 2 * request.limit  # that of forms that are made again ends first
    guard = Guard(f"bundle {request.path.name}", "take it for damaged or hostile", patience, quiet=True)
    try:
        return Outcome.from_plain(call_apart(_verified, request, guard=guard, say=say))
    except BrokenCall as error:
        return Outcome(
            digest=digest_of_file(request.path), faults=(Fault("crash", error.problem, error.hint, "unreadable"),)
        )


def digest_of_file(path: Path) -> str:
    """Return the SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _verified(request: Request, say: Callable[[str], None]) -> dict[str, Any]:
    """Return the outcome in plain values."""
    made = Outcome(digest=digest_of_file(request.path), with_run=request.run)
    try:
        archive = Archive.open(request.path)
        manifest = manifest_of(archive.json(MANIFEST))
        made = replace(
            made, method=manifest.method, title=manifest.title, author=manifest.author, licence=manifest.licence,
            versions=manifest.versions, plugin=manifest.plugin.digests[manifest.plugin.file] if manifest.plugin else "",
        )  # fmt: skip
        check = _Check(request, archive, manifest, say)
        check.require_whole()
        made = replace(made, faults=tuple(check.faults_of_method()))
        check.may_run = request.run and not made.faults
        return replace(made, rows=tuple(map(check.row, manifest.entries))).to_plain()
    except BundleError as error:
        return replace(made, faults=(*made.faults, Fault.of(error))).to_plain()


def _texts(record: Record) -> list[object]:
    """Texts of a record that are shown."""
    shown = [record[part] for part in ("gallery", "method", "title")] + [
        record["data"][part] for part in ("name", "title")
    ]
    return [*shown, record.get("scorer", ""), *(model["data"] for model in record.get("models", ()))]


@dataclass
class _Check:
    """A bundle at its verification."""

    request: Request
    archive: Archive
    manifest: Manifest
    say: Callable[[str], None]
    may_run: bool = False

    def require_whole(self) -> None:
        """Raise :class:`BundleError` unless the files are those that the manifest names, each once."""
        entries = self.manifest.entries
        if not entries:
            raise BundleError("no-records", "it holds no record", _ASK)
        if len({entry.key for entry in entries}) < len(entries):
            raise BundleError("name-twice", "it lists a record twice", _ASK)
        plugin = self.manifest.plugin.digests if self.manifest.plugin else {}
        wanted = {MANIFEST, *plugin, *(n for e in entries for n in (e.record, e.arrays, e.distances))}
        if missing := sorted(wanted - self.archive.parts.keys()):
            raise BundleError("file-missing", f"'{missing[0]}' is not in it", f"{_ASK} for the whole bundle")
        if further := sorted(self.archive.parts.keys() - wanted):
            raise BundleError("unknown-file", f"'{further[0]}' is in it, but nothing refers to it", _ASK)

    def faults_of_method(self) -> list[Fault]:
        """Return what is wrong with the method that the bundle names."""
        plugin, name = self.manifest.plugin, self.manifest.base_name
        if plugin is None:
            return []
        found = []
        if name in BUILT_IN:
            said = f"its plug-in calls itself '{name}', which is a method of the suite"
            found.append(lie("name-taken", said, "rename the method, run it and submit it again"))
        for file, told in plugin.digests.items():
            if hashlib.sha256(self.archive.read(file)).hexdigest() != told:
                said = f"'{file}' is not the source whose digest the bundle tells"
                found.append(lie("source-differs", said, "take the source for another one"))
        if not found and not self._is_source_of_records():
            said = f"'{plugin.file}' is not the source that its records were made by"
            found.append(lie("source-differs", said, "take the source for another one"))
        return found

    def _is_source_of_records(self) -> bool:
        """Return whether the source is that which the recipes of the records name; it is not run."""
        plugin = self.manifest.plugin
        assert plugin  # noqa: S101
        for entry in self.manifest.entries:
            recipe = self.archive.json(entry.record)["recipe"]
            sources = recipe["plugin"] if "plugin" in recipe else recipe["code"]["method"]["code"]  # of version 0.2
            known = {name: sources.get(name.removeprefix("plugin/")) for name in plugin.digests}
            try:
                if known[plugin.file] is None or any(
                    digest and digest_of_source(self.archive.read(name)) != digest for name, digest in known.items()
                ):
                    return False
            except (SyntaxError, ValueError, RecursionError):
                return False
        return True

    def record(self, entry: Entry) -> Record:
        """Return a record; raises :class:`BundleError` if it is none, contradicts itself, or is of another method."""
        record = self.archive.json(entry.record)
        if fault := fault_of(record):
            raise BundleError("record-edited", f"record {entry.key[:12]}: {fault}", "take it for edited", "false")
        if (record["key"], record["status"]) != (entry.key, "ok"):
            raise BundleError("no-records", f"record {entry.key[:12]} is of another job, or has no scores", _ASK)
        if any(len(str(text)) > LONGEST for text in _texts(record)):
            raise BundleError(
                "no-records", f"record {entry.key[:12]} has a name of more than {LONGEST} characters", _ASK
            )
        names = record["shapes"]
        if [*entry.inputs] != names:
            said = f"record {entry.key[:12]} names a shape twice, or others than the bundle"
            raise BundleError("name-twice", said, "give each shape a name of its own", "false")
        told = (record["method"], record["recipe"].get("method"))
        base = (split_name(str(record["method"])) or (record["method"],))[0]
        if told != (self.manifest.method, self.manifest.base_name) or base != told[1] or not is_name(base):
            raise BundleError("other-method", f"record {entry.key[:12]} is of method '{told[0]}'", _ASK, "false")
        return record  # type: ignore[no-any-return]

    def row(self, entry: Entry) -> RowOutcome:
        """Return what a record is."""
        record = self.record(entry)
        self.say(f"{record['gallery']} {record['input']}: computing the scores of {len(record['shapes'])} shapes")
        work = RowCheck(self.request.known, self.archive, entry, record)
        scored = work.computed()
        remade = Remade() if work.has_lied else self._again(work)
        work.faults += remade.faults
        if remade.distances is not None:
            scored = work.compared_with([np.array(remade.distances)])
        if scored is None and not work.faults:
            said = "its distances are made by a package that is not of the suite"
            work.faults.append(claim("not-run", said, "ask its author for a plug-in of one file"))
        found = scored or record
        queries = queries_of([{**record, "per_query": found["per_query"]}])
        ends = intervals(queries[[*PRINTED]].to_numpy(), queries["label"].tolist())
        cost = record.get("cost", {}).get("seconds_per_shape", {})
        return RowOutcome(
            key=entry.key, gallery=record["gallery"], data=record["data"]["name"], data_title=record["data"]["title"],
            input=record["input"], scorer=scorer_name(record), seed=int(record["recipe"].get("seed", 0)),
            gallery_digest=str(record["recipe"].get("gallery", "")), faults=tuple(work.faults),
            scores={name: float(found["scores"][name]) for name in PRINTED},
            told={name: float(record["scores"][name]) for name in PRINTED},
            intervals={name: (float(low), float(high)) for name, (low, high) in zip(PRINTED, ends, strict=True)},
            chance={name: float(record["chance"][name]) for name in PRINTED},
            n_shapes=record["n_shapes"], n_classes=record["n_classes"],
            coverage=len(answered_shapes(record)) / record["n_shapes"],
            seconds=float(sum(cost.values())) if cost else None, peak_mib=record.get("peak_mib"),
            trained_on=tuple(dict.fromkeys(model["data"] for model in record.get("models", ()))),
            holds=entry.holds, withheld=entry.withheld, compared=work.compared,
            again=remade.shapes, apart=remade.apart,
        )  # fmt: skip

    def _again(self, work: RowCheck) -> Remade:
        """Make forms again where that may be done, and say where it had to be."""
        entry, record, plugin = work.entry, work.record, self.manifest.plugin
        is_ours = plugin is None and self.manifest.base_name in BUILT_IN
        needs_code = plugin is not None and entry.holds == "descriptors"
        gallery = work.gallery
        if (is_ours and gallery) or (plugin and self.may_run and (gallery or needs_code)):
            names = answered_shapes(record) if gallery else []
            chosen = secrets.SystemRandom().sample(names, min(max(self.request.n_again, FEWEST_AGAIN), len(names)))
            self.say(f"{record['gallery']} {record['input']}: making {len(chosen)} forms again")
            known = self.request.known
            source = gallery.source if gallery else ""
            return made_again(
                Remaking(record, entry, source, known.data_root, known.results, tuple(chosen)),
                self.archive, plugin, self.request.limit,
            )  # fmt: skip
        if is_ours and not self.request.known.has_same(record):
            said = f"it bears the suite's name '{self.manifest.base_name}', and neither data nor a record here tells"
            return Remade((claim("not-made-again", said, "pass --data-root, -d FOLDER, or --results with its record"),))
        if needs_code:
            said = "its distances are made by its plug-in, which was not run"
            return Remade((claim("not-run", said, "pass --run where you may run a stranger's program"),))
        return Remade()
