"""A bundle of the finished jobs of a method."""

from __future__ import annotations

import hashlib
import io
import json
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from benchmark import __version__
from benchmark.arrays import Arrays, save_arrays
from benchmark.bundles.manifest import LONGEST, MANIFEST, NAMES, Entry, Holds, Manifest, Plugin
from benchmark.datasets.catalogue import CATALOGUE, catalogued, is_path
from benchmark.errors import BenchmarkError, ConfigurationError
from benchmark.files import write_atomically
from benchmark.pipeline.method_run import MethodRun
from benchmark.pipeline.preparation import require_arrays
from benchmark.pipeline.ranking import matrices_of
from benchmark.pipeline.recipes import distances_recipe, draws_of, features_recipe, source_data
from benchmark.pipeline.stages import form
from benchmark.pipeline.storage.environment import environment
from benchmark.pipeline.storage.keys import bare_key, digest
from benchmark.pipeline.storage.lock import key_of
from benchmark.pipeline.storage.merging import told
from benchmark.pipeline.storage.records import Record, answered_shapes, as_text, portable, scorer_name
from benchmark.pipeline.storage.store import StorageError
from benchmark.plugins.modules import helpers_of
from benchmark.plugins.output_checks import signature_of
from benchmark.plugins.registry import MethodSpec
from benchmark.plugins.scorers import BUILT_IN, ScorerSpec, scorer_of, scorers
from benchmark.plugins.serving import folded
from benchmark.report.artefact_reader import ArtefactReader

#: Array of a form that holds its faces where they are those of the shape; it counts to no digest.
FACES = "about:faces"

#: Parts of a record that nobody can check, or that tell of the disk that it was made on.
_DROPPED = ("traceback", "splits")

#: Date of each file in a bundle, so that the same results make the same bytes.
_DATE = (1980, 1, 1, 0, 0, 0)


@dataclass(frozen=True)
class Offer:
    """Words of whoever makes a bundle.

    Parameters
    ----------
    author, licence
        Who it is, and under which licence the bundle is passed on.
    with_forms
        Whether forms of data of one's own may be passed on.
    """

    author: str = ""
    licence: str = ""
    with_forms: bool = False


@dataclass(frozen=True)
class Written:
    """A bundle that was written.

    Parameters
    ----------
    size
        Its bytes.
    entries
        What each of its records is called, what it holds, and why it holds no forms.
    left_out
        Why other records are not in it.
    licence
        Under which it is passed on.
    """

    size: int
    entries: tuple[tuple[str, Holds, str], ...]
    left_out: tuple[str, ...]
    licence: str


def write_bundle(
    path: Path,
    records: Sequence[Record],
    spec: MethodSpec,
    artefacts: ArtefactReader,
    offer: Offer,
    say: Callable[[str], object] = lambda line: None,
) -> Written:
    """Write the records of a method with all from which their scores can be computed again.

    Of a set whose terms do not let it be passed on there are signatures and distances, no form.

    Parameters
    ----------
    path
        The file.
    records
        Records of jobs; of those without scores, or whose forms are not kept here, it is told why they are left out.
    spec
        The method.
    artefacts
        Where the forms are.
    offer
        Author, licence, and whether forms of data of one's own go along.
    say
        Told what is being done.

    Raises
    ------
    ConfigurationError
        If no record can be passed on, or author or licence is no short text.
    BenchmarkError
        If the file cannot be written.
    """
    if max(len(offer.author), len(offer.licence)) > LONGEST:
        raise ConfigurationError(f"--author or --licence has more than {LONGEST} characters", "shorten it")
    files: dict[str, bytes] = {}
    entries: list[Entry] = []
    names: list[tuple[str, Holds, str]] = []
    left_out: list[tuple[str, BenchmarkError]] = []
    for record in records:
        say(f"packing {told(record)}")
        try:
            entry, made = _packed(record, artefacts, offer)
        except BenchmarkError as error:
            left_out.append((told(record), error))
            continue
        files |= made
        entries.append(entry)
        names.append((told(record), entry.holds, entry.withheld))
    if not entries:
        first, why = left_out[0]
        raise ConfigurationError(f"no record of '{spec.name}' can be shared: {first}: {why.problem}", why.hint)
    sources = _sources(spec)
    plugin = None
    if sources:
        digests = {name: hashlib.sha256(text).hexdigest() for name, text in sources.items()}
        plugin = Plugin(next(iter(sources)), spec.target.rpartition(":")[2], digests)
    licence = offer.licence or ("" if spec.is_foreign else "MIT") or _stated(sources)
    versions = {"suite": __version__, **environment(), **_package(spec)}
    manifest = Manifest(spec.name, spec.base_name, spec.title, offer.author, licence, versions, plugin, tuple(entries))
    files = {MANIFEST: json.dumps(manifest.to_plain(), indent=1).encode(), **sources, **files}
    content = _zipped(files)
    try:
        write_atomically(path, lambda file: file.write(content))
    except OSError as error:
        raise BenchmarkError(f"cannot write {path}: {error.strerror}", "choose another file with -o") from error
    return Written(len(content), tuple(names), tuple(f"{name}: {why}" for name, why in left_out), licence)


def _packed(record: Record, artefacts: ArtefactReader, offer: Offer) -> tuple[Entry, dict[str, bytes]]:
    """Return the entry of a record and its files by name; raises ``BenchmarkError`` where something is not here."""
    if record["status"] != "ok":
        raise StorageError(f"it has no scores ({record['status']})", "only finished jobs can be shared")
    scorer = scorer_of(scorer_name(record) or ScorerSpec().name, scorers())
    if scorer.base_name not in BUILT_IN:
        raise ConfigurationError(f"scorer '{scorer.name}' is not in the suite", "nobody else could compare its scores")
    run = replace(artefacts.method_run(record), scorer_spec=scorer)
    store, dataset = run.store, run.preparation.dataset
    by_name = {entry.identifier: entry for entry in dataset.entries}
    if not set(record["shapes"]) <= by_name.keys():
        raise StorageError("its data changed", "run it again here")
    chosen = [by_name[name] for name in record["shapes"]]
    sources = {entry.identifier: str(source_data(dataset, entry)) for entry in chosen}
    if digest([(e.identifier, e.subject, sources[e.identifier]) for e in chosen]) != record["recipe"]["gallery"]:
        raise StorageError("its data changed", "run it again here")
    withheld = "" if run.describes else _withheld(record, artefacts.data_root, offer)
    found: list[Arrays] = []
    prepared = dict.fromkeys(record["shapes"], "")
    for name in answered_shapes(record):
        shape = store.find(run.preparation.recipe(by_name[name]), wanted=["vertices", "faces"].__contains__)
        answer = store.find(run.recipe(by_name[name]))
        if shape is None or answer is None:
            raise StorageError("its forms are not stored here, as today's code makes them", "run it again here")
        prepared[name] = shape.digest
        arrays = require_arrays(answer)
        if not run.describes:
            faces = arrays.get("faces", shape.arrays["faces"])
            arrays = {**arrays, FACES: faces}
            if withheld:
                arrays = _signature(run, by_name[name], arrays)
        found.append(arrays)
    forms = [run.recipe(by_name[name]) for name in answered_shapes(record)]
    stored = dict(matrices_of(record, store))
    recipes = [distances_recipe(forms, run.spec, scorer, draw) for draw in draws_of(run.spec, scorer)]
    matrices = [stored.get(bare_key(key_of(recipe))) for recipe in recipes]
    if any(matrix is None for matrix in matrices):
        raise StorageError("its distances are not stored here", "run it again here")
    holds: Holds = "descriptors" if run.describes else "signatures" if withheld else "forms"
    key = record["key"]
    entry = Entry(key, holds, withheld, {name: (sources[name], prepared[name]) for name in record["shapes"]})
    return entry, {
        entry.record: as_text(_without_places(record)).encode(),
        entry.arrays: _as_file(key, folded(found)),
        entry.distances: _as_file(key, folded([{"distances": matrix} for matrix in matrices if matrix is not None])),
    }


def _withheld(record: Record, data_root: Path | None, offer: Offer) -> str:
    """Return why the forms of a record are not passed on; "" if they may be."""
    data = record["data"]
    name = catalogued(str(data["name"]))
    if name in CATALOGUE and not CATALOGUE[name].is_shared:
        return f"{name}: its terms ({CATALOGUE[name].terms}) do not say that what is made of it may be passed on"
    if name is not None:
        return ""
    if data_root is not None and is_path(source := str(data["source"])) and _is_in(Path(source), data_root):
        return f"{data['name']} lies among the official sets, whose terms do not say that it may be passed on"
    return "" if offer.with_forms else f"{data['name']}: nobody has said that what is made of it may be passed on"


def _is_in(path: Path, folder: Path) -> bool:
    return path.resolve().is_relative_to(folder.resolve())


def _signature(run: MethodRun, entry: Any, arrays: Arrays) -> Arrays:
    """The signature of a form: the one that is kept, or made from it again."""
    recipe = features_recipe(run.recipe(entry), run.scorer_spec)
    kept = run.store.find_anywhere(recipe)
    if kept is not None:
        return require_arrays(kept)
    return signature_of(run.scorer, form.form_mesh(arrays, _triangles(arrays)))


def _triangles(arrays: Arrays) -> Any:
    """A shape with the triangles of a form of a bundle, and its vertices."""
    from benchmark.geometry.mesh import Mesh

    return Mesh(arrays["vertices"], arrays[FACES])


def _without_places(record: Record) -> Record:
    """A record without what cannot be checked, and without the paths of a disk."""
    found = {name: part for name, part in portable(record).items() if name not in _DROPPED}
    data = found["data"]
    module = Path(data["module"]).name if str(data["module"]).endswith(".py") else data["module"]
    return {**found, "data": {**data, "source": data["name"], "module": module}}


def _sources(spec: MethodSpec) -> dict[str, bytes]:
    """Files of the plug-in of a method, itself first; none of a method that is installed with its package."""
    if not spec.module.endswith(".py"):
        return {}
    main = Path(spec.module)
    files = {f"plugin/{main.name}": main}
    for file in helpers_of(main).values():
        of_package = file.parent.rglob("*.py") if file.name == "__init__.py" else [file]
        files |= {f"plugin/{each.relative_to(main.parent).as_posix()}": each for each in of_package}
    for name, file in files.items():
        if not NAMES.fullmatch(name):
            raise ConfigurationError(f"{file} is not a valid name in a bundle", "rename it: letters, digits and _")
    return {name: file.read_bytes() for name, file in files.items()}


def _package(spec: MethodSpec) -> dict[str, str]:
    """Version of the installed package that brings a method; nothing for one of the suite, or of a file."""
    if not spec.is_foreign or spec.module.endswith(".py"):
        return {}
    names = metadata.packages_distributions().get(spec.module.partition(".")[0], ())
    return {name: metadata.version(name) for name in names}


def _stated(sources: Mapping[str, bytes]) -> str:
    """Return the licence that a source states by SPDX; "" where nothing is said."""
    mark = b"SPDX-License-Identifier:"
    lines = (line for text in sources.values() for line in text.splitlines() if mark in line)
    return next((line.partition(mark)[2].decode("utf-8", "replace").strip() for line in lines), "")


def _as_file(key: str, arrays: Mapping[str, Any]) -> bytes:
    file = io.BytesIO()
    save_arrays(file, key, {name: np.asarray(array) for name, array in arrays.items()}, compressed=True)
    return file.getvalue()


def _zipped(files: Mapping[str, bytes]) -> bytes:
    """One zip file, the same for the same files."""
    whole = io.BytesIO()
    with zipfile.ZipFile(whole, "w") as archive:
        for name, content in _in_order(files):
            part = zipfile.ZipInfo(name, _DATE)
            part.compress_type = zipfile.ZIP_STORED if name.endswith(".npz") else zipfile.ZIP_DEFLATED
            part.external_attr = 0o644 << 16
            archive.writestr(part, content)
    return whole.getvalue()


def _in_order(files: Mapping[str, bytes]) -> Iterator[tuple[str, bytes]]:
    yield MANIFEST, files[MANIFEST]
    yield from sorted((name, content) for name, content in files.items() if name != MANIFEST)
