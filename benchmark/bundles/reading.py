"""Bundles as files: data from strangers, read within limits, of which nothing is unpacked onto the disk."""

from __future__ import annotations

import io
import re
import stat
import zipfile
from collections import Counter
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from benchmark.arrays import PACKED, Arrays, UnsafeArrays, load_arrays
from benchmark.errors import BenchmarkError, ShapeError
from benchmark.geometry.mesh import Mesh
from benchmark.pipeline.storage.record_schema import read_json
from benchmark.plugins.scorers import ScorerSpec
from benchmark.text import clean

MANIFEST = "bundle.json"

#: Names of the files of a bundle; the data files of a plugin lie beside it.
NAMES = re.compile(
    r"bundle\.json|records/[0-9a-f]{32}\.json|(?:arrays|distances)/[0-9a-f]{32}\.npz"
    r"|plugin/(?:\w[\w.-]*/)*\w[\w.-]*",
    re.ASCII,
)

#: Bytes of the largest bundle, of all its files together, of one of them, of JSON, and of the arrays in one file.
LARGEST_BUNDLE, LARGEST_TOTAL, LARGEST_FILE, LARGEST_JSON, LARGEST_ARRAYS = 2**30, 2**31, 2**29, 2**25, 2**30

MOST_FILES = 2000

_MOST_VERTICES = 1_000_000

#: Array of a form that holds its faces where they are those of the shape; it counts to no digest.
FACES = "about:faces"

#: Characters of the longest text of a bundle.
LONGEST = 500

Text = Annotated[str, Meta(max_length=LONGEST)]
#: Name of a mesh, which may be all parameters of a generator.
Source = Annotated[str, Meta(max_length=10_000)]

Format = Literal["canonical-forms bundle 1"]
Holds = Literal["forms", "signatures", "descriptors"]
Status = Literal["unreadable", "false", "claimed", "verified"]

_ASK = "ask its author for the file that 'submit' wrote"


class BundleError(BenchmarkError):
    """A fault of a bundle by its name, such as ``"path-outside"``, and what the whole bundle is by it."""

    def __init__(self, name: str, problem: str, hint: str = _ASK, status: Status = "unreadable") -> None:
        super().__init__(problem, hint)
        self.name, self.status = name, status


class Plugin(msgspec.Struct, frozen=True):
    """The plugin of a bundle: its file, its method in there, and the SHA-256 of its modules and data files."""

    file: Text
    attribute: Text
    digests: dict[Text, Text]

    def __post_init__(self) -> None:
        if self.file not in self.digests or not self.attribute.isidentifier():
            raise ValueError("its plugin is not among its files")
        if not all(name.startswith("plugin/") for name in self.digests):
            raise ValueError("a file of its plugin lies elsewhere")


class Entry(msgspec.Struct, frozen=True):
    """A record of a bundle, and what it was made from.

    Parameters
    ----------
    key
        Of the record; its files have this name.
    holds
        What the scores can be computed from.
    withheld
        Why forms are not in the bundle; "" where they are, or there are none.
    inputs
        For each shape the name of its mesh, and the digest of the prepared shape, "" for one without a result.
    """

    key: Annotated[str, Meta(pattern=r"^[0-9a-f]{32}\Z")]
    holds: Holds
    withheld: Text
    inputs: dict[Text, tuple[Source, Text]]

    @property
    def record(self) -> str:
        """Name of its record among the files."""
        return f"records/{self.key}.json"

    @property
    def arrays(self) -> str:
        """Name of its arrays among the files."""
        return f"arrays/{self.key}.npz"

    @property
    def distances(self) -> str:
        """Name of its distances among the files."""
        return f"distances/{self.key}.npz"


class Manifest(msgspec.Struct, frozen=True):
    """A bundle as it describes itself; ``base_name`` is that of the method without parameters."""

    method: Text
    base_name: Text
    title: Text
    author: Text
    licence: Text
    versions: dict[Text, Text]
    plugin: Plugin | None
    entries: tuple[Entry, ...]
    format: Format


class Archive(NamedTuple):
    """The files of a bundle, held in memory."""

    zip: zipfile.ZipFile
    files: dict[str, zipfile.ZipInfo]

    @classmethod
    def open(cls, path: Path) -> Archive:
        """Read a file; raises :class:`BundleError` unless the names and sizes in it are those of a bundle."""
        with path.open("rb") as file:
            content = file.read(LARGEST_BUNDLE + 1)
        if len(content) > LARGEST_BUNDLE:
            raise BundleError("too-large", f"{path.name} has more than {LARGEST_BUNDLE:,} bytes")
        try:
            archive = zipfile.ZipFile(io.BytesIO(content))
        except Exception as error:
            raise BundleError("no-zip", f"{path.name} is not a zip file, or is damaged") from error
        files = archive.infolist()
        for part in files:
            _check(part)
        repeated = [name for name, count in Counter(part.filename.casefold() for part in files).items() if count > 1]
        if repeated:
            raise BundleError("name-twice", f"two files in it are called '{repeated[0]}'")
        if len(files) > MOST_FILES or sum(part.file_size for part in files) > LARGEST_TOTAL:
            raise BundleError("too-large", f"it unpacks to more than {LARGEST_TOTAL:,} bytes, or many files")
        return cls(archive, {part.filename: part for part in files})

    def read(self, name: str) -> bytes:
        """Return a file; raises :class:`BundleError` if it is not there, or not as the bundle announces it."""
        if name not in self.files:
            raise BundleError("file-missing", f"'{name}' is not in it")
        size = self.files[name].file_size
        try:
            with self.zip.open(name) as file:
                content = file.read(size)  # no more than was announced, whatever unfolds
                is_whole = len(content) == size and not file.read(1)
        except Exception as error:
            raise BundleError("damaged", f"'{name}' in it cannot be read") from error
        if not is_whole:
            raise BundleError("too-large", f"'{name}' in it has another size than it announces")
        return content

    def json(self, name: str) -> Any:
        """Return a file of JSON; raises :class:`BundleError` as :meth:`read` does, and for anything else."""
        if name in self.files and self.files[name].file_size > LARGEST_JSON:
            raise BundleError("too-large", f"'{name}' in it unpacks to more than {LARGEST_JSON:,} bytes")
        try:
            return read_json(self.read(name))
        except (ValueError, RecursionError) as error:
            raise BundleError("no-json", f"'{name}' in it is not JSON, or contains NaN or Infinity") from error

    def manifest(self) -> Manifest:
        """Return what the bundle says of itself."""
        try:
            return msgspec.convert(self.json(MANIFEST), Manifest)
        except msgspec.ValidationError as error:
            problem = f"{MANIFEST} lacks a part, or holds something else in it ({clean(error)[:80]})"
            raise BundleError("no-bundle", problem, "make it with 'submit', and edit nothing") from error

    def require_files_of(self, manifest: Manifest) -> None:
        """Raise :class:`BundleError` unless the files are those that the manifest names, each once."""
        entries, sources = manifest.entries, manifest.plugin.digests if manifest.plugin else {}
        if not entries:
            raise BundleError("no-records", "it holds no record")
        if len({entry.key for entry in entries}) < len(entries):
            raise BundleError("name-twice", "it lists a record twice")
        names = {MANIFEST, *sources, *(n for e in entries for n in (e.record, e.arrays, e.distances))}
        if missing := sorted(names - self.files.keys()):
            raise BundleError("file-missing", f"'{missing[0]}' is not in it")
        if further := sorted(self.files.keys() - names):
            raise BundleError("unknown-file", f"'{further[0]}' is in it, but nothing refers to it")

    def arrays(self, name: str, key: str) -> dict[str, Any]:
        """Return the arrays of a file, of plain numbers alone; raises :class:`BundleError` for any other file."""
        content = self.read(name)
        try:
            return load_arrays(io.BytesIO(content), key, largest=LARGEST_ARRAYS)
        except UnsafeArrays as error:
            raise BundleError(error.name, f"'{name}' {error}") from error
        except Exception as error:
            raise BundleError("no-arrays", f"'{name}' holds no arrays, or those of another record") from error


def _check(part: zipfile.ZipInfo) -> None:
    """Raise :class:`BundleError` for a file that no bundle has."""
    name = part.orig_filename
    shown = ascii(name)[1:-1][:80]
    if stat.S_IFMT(part.external_attr >> 16) not in (0, stat.S_IFREG):
        raise BundleError("link", f"'{shown}' in it is a link or a device")
    if name.startswith("/") or "\\" in name or ":" in name or ".." in name.split("/"):
        raise BundleError("path-outside", f"'{shown}' points outside the bundle")
    if not NAMES.fullmatch(name) or name != part.filename:
        raise BundleError("unknown-file", f"'{shown}' does not belong in a bundle")
    if part.flag_bits & 1 or part.compress_type not in PACKED:
        raise BundleError("no-zip", f"'{shown}' in it is encrypted, or packed in an unusual way")
    if part.file_size > LARGEST_FILE:
        raise BundleError("too-large", f"'{shown}' unpacks to {part.file_size:,} bytes")


# Arrays --------------------------------------------------------------------------------------------------------------


def form_of(arrays: Arrays) -> Mesh:
    """Return a form of a bundle; raises ``InvalidMesh`` if it is none."""
    return Mesh(arrays["vertices"], arrays.get("faces", arrays[FACES]))


def check_form(name: str, arrays: Arrays, scorer: ScorerSpec | None) -> None:
    """Raise :class:`BundleError` unless arrays are a form."""
    try:
        if not len(arrays["vertices"]) <= _MOST_VERTICES:
            raise BundleError("too-large", f"the form of '{name}' has too many vertices", "ask its author")
        form_of(arrays)
    except ShapeError as error:
        raise BundleError("bad-form", f"the form of '{name}': {error.problem}", "ask its author") from error
    except (KeyError, TypeError) as error:
        raise BundleError("no-arrays", f"the form of '{name}' lacks vertices or faces", "ask its author") from error


def check_signature(name: str, arrays: Arrays, scorer: ScorerSpec | None) -> None:
    """Refuse what the compiled code of a scorer must not be given: it looks at no bound."""
    is_fine = all(array.dtype.kind in "biuf" and np.isfinite(array).all() for array in arrays.values())
    if is_fine and scorer and scorer.base_name == ScorerSpec().base_name:
        is_fine = arrays.keys() == {"descriptors", "view_offsets"} and _are_views(scorer, **arrays)
    elif is_fine:
        is_fine = arrays.keys() == {"energies"} and arrays["energies"].dtype == np.float64
    if not is_fine:
        raise BundleError("no-arrays", f"the signature of '{name}' does not come from its scorer", "ask its author")


def _are_views(scorer: ScorerSpec, descriptors: NDArray[Any], view_offsets: NDArray[Any]) -> bool:
    from retrieval.features import DESCRIPTOR_SIZE

    created: Any = scorer.create()
    return (
        descriptors.dtype == np.uint8
        and descriptors.ndim == 2
        and descriptors.shape[1] == DESCRIPTOR_SIZE
        and view_offsets.dtype == np.int32
        and view_offsets.shape == (created.n_views + 1,)
        and bool(view_offsets[0] == 0 and view_offsets[-1] == len(descriptors) and (np.diff(view_offsets) >= 0).all())
    )


def check_descriptor(name: str, arrays: Arrays, scorer: ScorerSpec | None) -> None:
    """Raise :class:`BundleError` unless arrays are a descriptor."""
    vector = arrays.get("descriptor")
    if vector is None or vector.ndim != 1 or vector.dtype != np.float64 or not np.isfinite(vector).all():
        raise BundleError("no-arrays", f"the descriptor of '{name}' is not a finite vector", "ask its author")


CHECKS = {"forms": check_form, "signatures": check_signature, "descriptors": check_descriptor}
