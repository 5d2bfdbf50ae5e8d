"""Verify a bundle: recompute its scores from its content and compare them with the stated scores."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from hashlib import sha256
from pathlib import Path
from typing import Any, cast

import msgspec
from msgspec.structs import replace

from benchmark.bundles.archive import LONGEST, Archive, BundleError, Entry, Fault, Manifest, Plugin
from benchmark.bundles.outcomes import Outcome
from benchmark.bundles.rows import Request, RowCheck
from benchmark.errors import BenchmarkError
from benchmark.execution.processes.calls import BrokenCall, call_apart
from benchmark.pipeline.storage.record_schema import fault_of
from benchmark.pipeline.storage.records import Record
from benchmark.plugins.parameters import split_name
from benchmark.plugins.registry import BUILT_IN
from benchmark.source_code import digest_of_source
from benchmark.text import is_name

_ASK = "ask its author"


def verify(request: Request, say: Callable[[str], None] = lambda line: None) -> Outcome:
    """Verify a bundle in a separate process, which it may crash.

    Raises
    ------
    BenchmarkError
        If the file cannot be read.
    """
    if not request.path.is_file():
        raise BenchmarkError(f"{request.path} is not a file", "name a bundle that 'submit' wrote")
    patience = request.limit and 2 * request.limit  # recomputing forms has a shorter limit
    what, hint = f"bundle {request.path.name}", "treat it as damaged or hostile"
    try:
        outcome = call_apart(verified, request, what=what, hint=hint, limit=patience, quiet=True, say=say)
        return msgspec.convert(outcome, Outcome)
    except BrokenCall as error:
        fault = Fault("crash", error.problem, error.hint, "unreadable")
        return Outcome(digest=_digest_of_file(request.path), faults=(fault,))


def _digest_of_file(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def verified(request: Request, say: Callable[[str], None]) -> dict[str, Any]:
    """Return the outcome of a bundle as plain values."""
    outcome = Outcome(digest=_digest_of_file(request.path), with_run=request.run)
    try:
        archive = Archive(request.path)
        manifest = archive.manifest()
        plugin, parts = manifest.plugin, ("method", "title", "author", "licence", "versions")
        about = {part: getattr(manifest, part) for part in parts}
        outcome = replace(outcome, **about, plugin=plugin.digests[plugin.file] if plugin else "")
        archive.require_files_of(manifest)
        records = [_record(archive, manifest, entry) for entry in manifest.entries]
        outcome = replace(outcome, faults=tuple(_faults_of_plugin(archive, manifest, records)) if plugin else ())
        may_run = request.run and not outcome.faults
        checks = zip(manifest.entries, records, strict=True)
        rows = (RowCheck(request, archive, entry, record, plugin, may_run, say) for entry, record in checks)
        return replace(outcome, rows=tuple(row.outcome() for row in rows)).to_plain()
    except BundleError as error:
        return replace(outcome, faults=(*outcome.faults, error.fault)).to_plain()


def _faults_of_plugin(archive: Archive, manifest: Manifest, records: Sequence[Record]) -> Iterator[Fault]:
    """Return the faults of the plugin in a bundle, without running it."""
    plugin, hint = cast(Plugin, manifest.plugin), "treat the source as a different one"
    contents = {file: archive.read(file) for file in plugin.digests}
    if manifest.base_name in BUILT_IN:
        problem = f"its plugin calls itself '{manifest.base_name}', which is a method of the suite"
        yield Fault("name-taken", problem, "rename the method, run it and submit it again", "false")
    edited = [file for file, text in contents.items() if sha256(text).hexdigest() != plugin.digests[file]]
    for file in edited:
        problem = f"'{file}' does not have the digest stated in the bundle"
        yield Fault("source-differs", problem, hint, "false")
    if not edited and not all(_is_source_of(record, plugin.file, contents) for record in records):
        yield Fault("source-differs", f"'{plugin.file}' is not the source of its records", hint, "false")


def _is_source_of(record: Record, plugin: str, contents: Mapping[str, bytes]) -> bool:
    """Return whether the files of a plugin are those in the recipe of a record."""
    recipe = record["recipe"]
    try:
        sources = recipe["plugin"] if "plugin" in recipe else recipe["code"]["method"]["code"]  # of version 0.2
        named = {file: name for file in contents if (name := file.removeprefix("plugin/")) in sources}
        return plugin in named and all(_digest(file, contents[file]) == sources[name] for file, name in named.items())
    except (KeyError, SyntaxError, ValueError, RecursionError):
        return False


def _digest(file: str, content: bytes) -> str:
    """Return the digest of a module or a data file as it appears in recipes."""
    return digest_of_source(content) if file.endswith(".py") else sha256(content).hexdigest()[:32]


def _record(archive: Archive, manifest: Manifest, entry: Entry) -> Record:
    """Return a record; raise :class:`BundleError` if it is invalid, inconsistent, or of another method."""
    record, what = archive.json(entry.files[0]), f"record {entry.key[:12]}"
    if fault := fault_of(record):
        raise BundleError("record-edited", f"{what}: {fault}", "treat it as edited", "false")
    if (record["key"], record["status"]) != (entry.key, "ok"):
        raise BundleError("no-records", f"{what} belongs to another job or has no scores", _ASK)
    texts = [*(record[part] for part in ("gallery", "method", "title")), record.get("scorer", "")]  # shown in reports
    texts += [*(record["data"][part] for part in ("name", "title")), *(m["data"] for m in record.get("models", ()))]
    if any(len(text) > LONGEST for text in texts):
        raise BundleError("no-records", f"{what} has a name of more than {LONGEST} characters", _ASK)
    if [*entry.inputs] != record["shapes"]:
        problem = f"{what} names a shape twice, or other shapes than the bundle"
        raise BundleError("name-twice", problem, "give each shape a unique name", "false")
    name, base = record["method"], record["recipe"].get("method")
    is_named = (name, base) == (manifest.method, manifest.base_name)
    if not is_named or (split_name(name) or (name,))[0] != base or not is_name(base):
        raise BundleError("other-method", f"{what} belongs to method '{name}'", _ASK, "false")
    return record  # type: ignore[no-any-return]
