"""Pack the finished jobs of a method into a bundle."""

from __future__ import annotations

import hashlib
import io
import json
import zipfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from importlib import metadata
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from benchmark import __version__
from benchmark.arrays import Arrays, save_arrays
from benchmark.bundles.archive import FACES, LONGEST, MANIFEST, NAMES, Entry, Holds, Manifest, Plugin
from benchmark.datasets.base import Entry as Shape
from benchmark.datasets.catalogue import CATALOGUE, catalogued, is_path
from benchmark.errors import BenchmarkError, ConfigurationError
from benchmark.files import write_atomically
from benchmark.pipeline.method_run import MethodRun, require_arrays
from benchmark.pipeline.ranking import matrices_of
from benchmark.pipeline.recipes import distances_recipe, draws_of, gallery_digest, source_data
from benchmark.pipeline.storage.environment import environment
from benchmark.pipeline.storage.keys import bare_key, is_edited
from benchmark.pipeline.storage.lock import key_of
from benchmark.pipeline.storage.merging import job_name
from benchmark.pipeline.storage.records import Record, answered_shapes, as_text, portable, scorer_name
from benchmark.pipeline.storage.store import StorageError
from benchmark.plugins.modules import helpers_of
from benchmark.plugins.registry import MethodSpec
from benchmark.plugins.remote import folded
from benchmark.plugins.scorers import BUILT_IN, DEFAULT, scorer_of, scorers
from benchmark.report.artefact_reader import ArtefactReader

#: Parts of a record that cannot be checked or that describe the machine that computed it.
_DROPPED = ("traceback",)

#: Fixed date of all files in a bundle, so that the same results give the same bytes.
_DATE = (1980, 1, 1, 0, 0, 0)

_AGAIN = "run it again here"


class Packed(NamedTuple):
    """Content of a bundle: entries by the names of their records, the licence, and reasons for omissions."""

    entries: dict[str, Entry]
    licence: str
    omitted: list[str]


def write_bundle(
    path: Path,
    records: Sequence[Record],
    spec: MethodSpec,
    artefacts: ArtefactReader,
    *,
    author: str = "",
    licence: str = "",
    with_forms: bool = False,
    say: Callable[[str], object],
) -> Packed:
    """Write the records of a method with the data needed to recompute their scores.

    For data sets that must not be redistributed, signatures and distances replace the forms; forms of private data are
    included only if ``with_forms``. Records without scores, or whose forms are not stored here, are omitted.

    Raises
    ------
    ConfigurationError
        If no record can be packed, or ``author`` or ``licence`` is too long.
    BenchmarkError
        If the file cannot be written.
    """
    if max(len(author), len(licence)) > LONGEST:
        raise ConfigurationError(f"--author or --licence has more than {LONGEST} characters", "shorten it")
    files: dict[str, bytes] = {}
    entries: dict[str, Entry] = {}
    faults: dict[str, BenchmarkError] = {}
    for record in records:
        name = job_name(record)
        say(f"packing {name}")
        try:
            entries[name], contents = _packed(record, artefacts, with_forms=with_forms)
            files.update(zip(entries[name].files, contents, strict=True))
        except BenchmarkError as error:
            faults[name] = error
    if not entries:
        name, fault = next(iter(faults.items()))
        raise ConfigurationError(f"no record of '{spec.name}' can be shared: {name}: {fault.problem}", fault.hint)
    sources, omitted = _sources(spec, records)
    digests = {name: hashlib.sha256(text).hexdigest() for name, text in sources.items()}
    plugin = Plugin(next(iter(sources)), spec.target.rpartition(":")[2], digests) if sources else None
    licence = licence or ("" if spec.is_foreign else "MIT") or _stated(sources)
    manifest = Manifest(
        spec.name, spec.base_name, spec.title, author, licence,
        {"suite": __version__, **environment(), **_package(spec)}, plugin, tuple(entries.values()),
        "canonical-forms bundle 1",
    )  # fmt: skip
    text = json.dumps(msgspec.to_builtins(manifest), indent=1)
    content = _zipped({MANIFEST: text.encode(), **dict(sorted({**sources, **files}.items()))})
    try:
        write_atomically(path, lambda file: file.write(content))
    except OSError as error:
        raise BenchmarkError(f"cannot write {path}: {error.strerror}", "choose another file with -o") from error
    return Packed(entries, licence, [*(f"{name}: {fault}" for name, fault in faults.items()), *omitted])


def _packed(record: Record, artefacts: ArtefactReader, *, with_forms: bool) -> tuple[Entry, tuple[bytes, ...]]:
    """Return the entry of a record and its files; raise ``BenchmarkError`` if something is missing."""
    if record["status"] != "ok":
        raise StorageError(f"it has no scores ({record['status']})", "only finished jobs can be shared")
    if is_edited(record["key"]):
        raise StorageError("it was made by edited code", "run make golden, or undo the edit and run again")
    scorer = scorer_of(scorer_name(record) or DEFAULT, scorers())
    if scorer.base_name not in BUILT_IN:
        raise ConfigurationError(f"scorer '{scorer.name}' is not in the suite", "others could not compare its scores")
    run = replace(artefacts.method_run(record), scorer_spec=scorer)
    dataset = run.preparation.dataset
    shapes = {entry.identifier: entry for entry in dataset.entries if entry.identifier in record["shapes"]}
    sources = {name: str(source_data(dataset, shapes[name])) for name in record["shapes"] if name in shapes}
    gallery = [shapes[name] for name in sources]
    if gallery_digest(gallery, lambda entry: sources[entry.identifier]) != record["recipe"]["gallery"]:
        raise StorageError("its data changed", _AGAIN)
    withheld = "" if run.describes else _withheld(record, artefacts.data_root, with_forms=with_forms)
    answered = [shapes[name] for name in answered_shapes(record)]
    forms = {entry.identifier: _form(run, entry, has_form=not withheld) for entry in answered}
    recipes = list(map(run.recipe, answered))
    keys = [bare_key(key_of(distances_recipe(recipes, run.spec, scorer, draw))) for draw in draws_of(run.spec, scorer)]
    matrices = dict(matrices_of(record, run.store))
    if not set(keys) <= matrices.keys():
        raise StorageError("its distances are not stored here", _AGAIN)
    holds: Holds = "descriptors" if run.describes else "signatures" if withheld else "forms"
    inputs = {name: (source, forms[name][1] if name in forms else "") for name, source in sources.items()}
    text = as_text(_without_places(record)).encode()
    arrays = ([arrays for arrays, _ in forms.values()], [{"distances": matrices[key]} for key in keys])
    return Entry(record["key"], holds, withheld, inputs), (text, *(_as_file(record["key"], items) for items in arrays))


def _form(run: MethodRun, entry: Shape, *, has_form: bool) -> tuple[Arrays, str]:
    """Return the form, signature or descriptor of a shape, and the digest of the prepared shape."""
    shape = run.store.find(run.preparation.recipe(entry), wanted=["vertices", "faces"].__contains__)
    answer = run.store.find(run.recipe(entry))
    if shape is None or answer is None:
        raise StorageError("its forms by the current code are not stored here", _AGAIN)
    arrays = require_arrays(answer)
    if run.describes:
        return arrays, shape.digest
    if not has_form:
        return run.signature_arrays(entry), shape.digest
    return {**arrays, FACES: arrays.get("faces", shape.arrays["faces"])}, shape.digest


def _withheld(record: Record, data_root: Path | None, *, with_forms: bool) -> str:
    """Return why the forms of a record are withheld; "" if they are not."""
    data = record["data"]
    name = catalogued(str(data["name"]))
    if name in CATALOGUE and not CATALOGUE[name].is_shared:
        return f"{name}: its terms ({CATALOGUE[name].terms}) do not say that what is made of it may be passed on"
    if name is not None:
        return ""
    source = str(data["source"])
    if data_root is not None and is_path(source) and Path(source).resolve().is_relative_to(data_root.resolve()):
        return f"{data['name']} lies among the official sets, whose terms do not say that it may be passed on"
    return "" if with_forms else f"{data['name']}: nobody has said that what is made of it may be passed on"


def _without_places(record: Record) -> Record:
    """Return a record without parts that cannot be checked, and without local paths."""
    parts = {name: part for name, part in portable(record).items() if name not in _DROPPED}
    data = parts["data"]
    module = Path(data["module"]).name if str(data["module"]).endswith(".py") else data["module"]
    return {**parts, "data": {**data, "source": data["name"], "module": module}}


def _sources(spec: MethodSpec, records: Sequence[Record]) -> tuple[dict[str, bytes], list[str]]:
    """Return the files of a plugin, its own file first, with the data files that it read, and reasons for omissions."""
    if not spec.module.endswith(".py"):
        return {}, []
    plugin = Path(spec.module)
    folder = plugin.resolve().parent
    modules = [plugin]
    for file in helpers_of(plugin).values():
        modules += file.parent.rglob("*.py") if file.name == "__init__.py" else [file]
    paths = {f"plugin/{file.relative_to(plugin.parent).as_posix()}": file for file in modules}
    data = {folder / name for name in spec.info.files} | {
        Path(p) for record in records for p in record.get("files", ())
    }
    omitted = []
    for file in sorted(data):
        if file.resolve().is_relative_to(folder) and file.is_file():
            paths.setdefault(f"plugin/{file.resolve().relative_to(folder).as_posix()}", file)
        else:
            omitted.append(f"{file}: it is not next to the plugin")
    for name, file in paths.items():
        if not NAMES.fullmatch(name):
            raise ConfigurationError(f"{file} is not a valid name in a bundle", "rename it: letters, digits and _")
    return {name: file.read_bytes() for name, file in paths.items()}, omitted


def _package(spec: MethodSpec) -> dict[str, str]:
    """Return the version of the installed package that provides a method; empty for other methods."""
    if not spec.is_foreign or spec.module.endswith(".py"):
        return {}
    names = metadata.packages_distributions().get(spec.module.partition(".")[0], ())
    return {name: metadata.version(name) for name in names}


def _stated(sources: Mapping[str, bytes]) -> str:
    """Return the SPDX licence stated in the sources; "" if there is none."""
    mark = b"SPDX-License-Identifier:"
    lines = (line for text in sources.values() for line in text.splitlines() if mark in line)
    return next((line.partition(mark)[2].decode("utf-8", "replace").strip() for line in lines), "")


def _as_file(key: str, items: Sequence[Any]) -> bytes:
    file = io.BytesIO()
    save_arrays(file, key, folded(items), compressed=True)
    return file.getvalue()


def _zipped(files: Mapping[str, bytes]) -> bytes:
    """Return a zip file that depends only on the files."""
    whole = io.BytesIO()
    with zipfile.ZipFile(whole, "w") as archive:
        for name, content in files.items():
            part = zipfile.ZipInfo(name, _DATE)
            part.compress_type = zipfile.ZIP_STORED if name.endswith(".npz") else zipfile.ZIP_DEFLATED
            part.external_attr = 0o644 << 16
            archive.writestr(part, content)
    return whole.getvalue()
