"""Verification of a bundle: its scores are computed again from what it holds, and compared with what it says."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from benchmark.bundles.outcomes import Fault, Outcome, RowOutcome
from benchmark.bundles.reading import LONGEST, Archive, BundleError, Entry, Manifest, Plugin
from benchmark.bundles.rows import Request, RowCheck
from benchmark.errors import BenchmarkError
from benchmark.execution.processes.calls import BrokenCall, Guard, call_apart
from benchmark.pipeline.storage.record_schema import fault_of
from benchmark.pipeline.storage.records import Record
from benchmark.plugins.parameters import split_name
from benchmark.plugins.registry import BUILT_IN
from benchmark.source_code import digest_of_source
from benchmark.text import is_name

_ASK = "ask its author"


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
        return msgspec.convert(call_apart(verified, request, guard=guard, say=say), Outcome)
    except BrokenCall as error:
        fault = Fault("crash", error.problem, error.hint, "unreadable")
        return Outcome(digest=_digest_of_file(request.path), faults=(fault,))


def _digest_of_file(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def verified(request: Request, say: Callable[[str], None]) -> dict[str, Any]:
    """Return the outcome of a bundle in plain values."""
    outcome = Outcome(digest=_digest_of_file(request.path), with_run=request.run)
    try:
        archive = Archive.open(request.path)
        manifest = archive.manifest()
        outcome = msgspec.structs.replace(
            outcome, method=manifest.method, title=manifest.title, author=manifest.author, licence=manifest.licence,
            versions=manifest.versions, plugin=manifest.plugin.digests[manifest.plugin.file] if manifest.plugin else "",
        )  # fmt: skip
        archive.require_files_of(manifest)
        check = _Check(request, archive, manifest, say)
        outcome = msgspec.structs.replace(outcome, faults=tuple(check.faults_of_method()))
        may_run = request.run and not outcome.faults
        rows = tuple(check.row(entry, may_run=may_run) for entry in manifest.entries)
        return msgspec.structs.replace(outcome, rows=rows).to_plain()
    except BundleError as error:
        return msgspec.structs.replace(outcome, faults=(*outcome.faults, Fault.of(error))).to_plain()


@dataclass(frozen=True)
class _Check:
    """A bundle at its verification."""

    request: Request
    archive: Archive
    manifest: Manifest
    say: Callable[[str], None]

    def faults_of_method(self) -> list[Fault]:
        """Return what is wrong with the method that the bundle names."""
        plugin, name = self.manifest.plugin, self.manifest.base_name
        if plugin is None:
            return []
        faults = []
        if name in BUILT_IN:
            problem = f"its plugin calls itself '{name}', which is a method of the suite"
            faults.append(Fault("name-taken", problem, "rename the method, run it and submit it again", "false"))
        other, hint = "take the source for another one", "source-differs"
        for file, digest in plugin.digests.items():
            if hashlib.sha256(self.archive.read(file)).hexdigest() != digest:
                problem = f"'{file}' is not the source whose digest the bundle tells"
                faults.append(Fault(hint, problem, other, "false"))
        if not faults and not all(self._is_source_of(entry, plugin) for entry in self.manifest.entries):
            problem = f"'{plugin.file}' is not the source that its records were made by"
            faults.append(Fault(hint, problem, other, "false"))
        return faults

    def _is_source_of(self, entry: Entry, plugin: Plugin) -> bool:
        """Return whether the source is that which the recipe of a record names; it is not run."""
        recipe = self.archive.json(entry.record)["recipe"]
        sources = recipe["plugin"] if "plugin" in recipe else recipe["code"]["method"]["code"]  # of version 0.2
        named = {file: sources[name] for file in plugin.digests if (name := file.removeprefix("plugin/")) in sources}
        try:
            return plugin.file in named and all(self._digest(file) == digest for file, digest in named.items())
        except (SyntaxError, ValueError, RecursionError):
            return False

    def _digest(self, file: str) -> str:
        """Return the digest by which a recipe names a module, or a data file."""
        content = self.archive.read(file)
        return digest_of_source(content) if file.endswith(".py") else hashlib.sha256(content).hexdigest()[:32]

    def row(self, entry: Entry, *, may_run: bool) -> RowOutcome:
        """Return what a record is."""
        record = self._record(entry)
        return RowCheck(self.request, self.archive, entry, record, self.manifest.plugin, may_run, self.say).outcome()

    def _record(self, entry: Entry) -> Record:
        """Return a record; raises :class:`BundleError` if it is none, contradicts itself, or is of another method."""
        record, what = self.archive.json(entry.record), f"record {entry.key[:12]}"
        if fault := fault_of(record):
            raise BundleError("record-edited", f"{what}: {fault}", "take it for edited", "false")
        if (record["key"], record["status"]) != (entry.key, "ok"):
            raise BundleError("no-records", f"{what} is of another job, or has no scores", _ASK)
        if any(len(str(text)) > LONGEST for text in _texts(record)):
            raise BundleError("no-records", f"{what} has a name of more than {LONGEST} characters", _ASK)
        if [*entry.inputs] != record["shapes"]:
            problem = f"{what} names a shape twice, or others than the bundle"
            raise BundleError("name-twice", problem, "give each shape a name of its own", "false")
        name, base = record["method"], record["recipe"].get("method")
        is_named = (name, base) == (self.manifest.method, self.manifest.base_name)
        if not is_named or (split_name(name) or (name,))[0] != base or not is_name(base):
            raise BundleError("other-method", f"{what} is of method '{name}'", _ASK, "false")
        return record  # type: ignore[no-any-return]


def _texts(record: Record) -> list[object]:
    """Texts of a record that are shown."""
    texts = [record[part] for part in ("gallery", "method", "title")]
    texts += [record["data"][part] for part in ("name", "title")]
    return [*texts, record.get("scorer", ""), *(model["data"] for model in record.get("models", ()))]
