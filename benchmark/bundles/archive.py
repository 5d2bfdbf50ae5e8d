"""File format of bundles, and a reader for untrusted files that limits sizes and unpacks nothing to disk."""

from __future__ import annotations

import io
import re
import stat
import zipfile
from collections import Counter
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from benchmark.arrays import PACKED, Arrays, UnsafeArrays, load_arrays
from benchmark.errors import BenchmarkError, ShapeError
from benchmark.geometry.mesh import Mesh
from benchmark.pipeline.storage.record_schema import read_json
from benchmark.plugins.scorers import DEFAULT, ScorerSpec
from benchmark.text import clean

MANIFEST = "bundle.json"

#: File names allowed in a bundle; a plugin and its data files share the folder ``plugin``.
NAMES = re.compile(
    r"bundle\.json|records/[0-9a-f]{32}\.json|(?:arrays|distances)/[0-9a-f]{32}\.npz"
    r"|plugin/(?:\w[\w.-]*/)*\w[\w.-]*",
    re.ASCII,
)

#: Maximum sizes in bytes: a bundle, all its files unpacked, one file, one JSON file, and the arrays of one file.
LARGEST_BUNDLE, LARGEST_TOTAL, LARGEST_FILE, LARGEST_JSON, LARGEST_ARRAYS = 2**30, 2**31, 2**29, 2**25, 2**30

MOST_FILES, _MOST_VERTICES = 2000, 1_000_000

#: Name of the array with the faces of a form if they equal those of the shape; digests exclude it.
FACES = "about:faces"

#: Maximum length of a text in a bundle, in characters.
LONGEST = 500

Text = Annotated[str, Meta(max_length=LONGEST)]
#: Name of a mesh; longer than ``Text`` because it may list all parameters of a generator.
Source = Annotated[str, Meta(max_length=10_000)]

Format = Literal["canonical-forms bundle 1"]
Holds = Literal["forms", "signatures", "descriptors"]
Status = Literal["unreadable", "false", "claimed", "verified"]


class Fault(msgspec.Struct, frozen=True):
    """A named reason why a record or a bundle is not verified.

    The status is ``"claimed"`` if a statement cannot be checked, ``"false"`` if it contradicts a computed or known
    value.
    """

    name: str
    problem: str
    hint: str
    status: Status


class BundleError(BenchmarkError):
    """A fault that ends the verification of a bundle."""

    def __init__(
        self,
        name: str,
        problem: str,
        hint: str = "ask its author for the original file written by 'submit'",
        status: Status = "unreadable",
    ) -> None:
        super().__init__(problem, hint)
        self.fault = Fault(name, problem, hint, status)


class Plugin(msgspec.Struct, frozen=True):
    """The plugin of a bundle: its file, its method, and the SHA-256 of its modules and data files."""

    file: Text
    attribute: Text
    digests: dict[Text, Text]

    def __post_init__(self) -> None:
        if self.file not in self.digests or not self.attribute.isidentifier():
            raise ValueError("its plugin is not among its files")
        if not all(name.startswith("plugin/") for name in self.digests):
            raise ValueError("a file of its plugin is in another folder")


class Entry(msgspec.Struct, frozen=True):
    """A record in a bundle and its data.

    Parameters
    ----------
    key
        Key of the record; its files are named after it.
    holds
        Kind of data from which the scores can be computed.
    withheld
        Reason why the bundle has no forms; "" if it has forms or the method computes none.
    inputs
        Name of the mesh and digest of the prepared shape, for each shape; the digest is "" without a result.
    """

    key: Annotated[str, Meta(pattern=r"^[0-9a-f]{32}\Z")]
    holds: Holds
    withheld: Text
    inputs: dict[Text, tuple[Source, Text]]

    @property
    def files(self) -> tuple[str, str, str]:
        """Names of the files of its record, arrays and distances."""
        return f"records/{self.key}.json", f"arrays/{self.key}.npz", f"distances/{self.key}.npz"


class Manifest(msgspec.Struct, frozen=True):
    """Description of a bundle; ``base_name`` is the name of the method without parameters."""

    method: Text
    base_name: Text
    title: Text
    author: Text
    licence: Text
    versions: dict[Text, Text]
    plugin: Plugin | None
    entries: tuple[Entry, ...]
    format: Format


class Archive:
    """Files of a bundle in memory; raises :class:`BundleError` if their names or sizes are not allowed."""

    def __init__(self, path: Path) -> None:
        with path.open("rb") as file:
            content = file.read(LARGEST_BUNDLE + 1)
        if len(content) > LARGEST_BUNDLE:
            raise BundleError("too-large", f"{path.name} has more than {LARGEST_BUNDLE:,} bytes")
        try:
            self.zip = zipfile.ZipFile(io.BytesIO(content))
        except Exception as error:
            raise BundleError("no-zip", f"{path.name} is not a zip file, or is damaged") from error
        parts = self.zip.infolist()
        for part in parts:
            _check_part(part)
        (name, count), *_ = Counter(part.filename.casefold() for part in parts).most_common(1) or [("", 0)]
        if count > 1:
            raise BundleError("name-twice", f"two files in it are called '{name}'")
        if len(parts) > MOST_FILES or sum(part.file_size for part in parts) > LARGEST_TOTAL:
            raise BundleError("too-large", f"it would unpack to over {LARGEST_TOTAL:,} bytes, or to too many files")
        self.sizes = {part.filename: part.file_size for part in parts}

    def read(self, name: str, largest: int = LARGEST_FILE) -> bytes:
        """Return a file; raise :class:`BundleError` if it is missing, too large, or not of the stated size."""
        if name not in self.sizes:
            raise BundleError("file-missing", f"'{name}' is not in it")
        if (size := self.sizes[name]) > largest:
            raise BundleError("too-large", f"'{name}' in it would unpack to more than {largest:,} bytes")
        try:
            with self.zip.open(name) as file:
                content = file.read(size)  # at most the stated size, whatever the data unpack to
                is_whole = len(content) == size and not file.read(1)
        except Exception as error:
            raise BundleError("damaged", f"'{name}' in it cannot be read") from error
        if not is_whole:
            raise BundleError("too-large", f"'{name}' in it does not have the stated size")
        return content

    def json(self, name: str) -> Any:
        """Return the content of a JSON file."""
        try:
            return read_json(self.read(name, LARGEST_JSON))
        except (ValueError, RecursionError) as error:
            raise BundleError("no-json", f"'{name}' in it is not JSON, or contains NaN or Infinity") from error

    def arrays(self, name: str, key: str) -> dict[str, Any]:
        """Return the arrays of a file, which may hold only numbers."""
        content = self.read(name)
        try:
            return load_arrays(io.BytesIO(content), key, largest=LARGEST_ARRAYS)
        except UnsafeArrays as error:
            raise BundleError(error.name, f"'{name}' {error}") from error
        except Exception as error:
            raise BundleError("no-arrays", f"'{name}' contains no arrays, or those of another record") from error

    def manifest(self) -> Manifest:
        """Return the description of the bundle."""
        try:
            return msgspec.convert(self.json(MANIFEST), Manifest)
        except msgspec.ValidationError as error:
            problem = f"{MANIFEST} has a missing or invalid part ({clean(error)[:80]})"
            raise BundleError("no-bundle", problem, "create it with 'submit', and do not edit it") from error

    def require_files_of(self, manifest: Manifest) -> None:
        """Raise :class:`BundleError` unless the files are exactly those named in the manifest."""
        if not manifest.entries:
            raise BundleError("no-records", "it holds no record")
        if len({entry.key for entry in manifest.entries}) < len(manifest.entries):
            raise BundleError("name-twice", "it lists a record twice")
        names = {MANIFEST, *(manifest.plugin.digests if manifest.plugin else ())}
        names.update(*(entry.files for entry in manifest.entries))
        if missing := sorted(names - self.sizes.keys()):
            raise BundleError("file-missing", f"'{missing[0]}' is not in it")
        if further := sorted(self.sizes.keys() - names):
            raise BundleError("unknown-file", f"'{further[0]}' is in it, but nothing refers to it")


def _check_part(part: zipfile.ZipInfo) -> None:
    """Raise :class:`BundleError` for a file that does not belong in a bundle."""
    name = part.orig_filename
    is_outside = name.startswith("/") or "\\" in name or ":" in name or ".." in name.split("/")
    checks = (
        (stat.S_IFMT(part.external_attr >> 16) not in (0, stat.S_IFREG), "link", "in it is a link or a device"),
        (is_outside, "path-outside", "points outside the bundle"),
        (not NAMES.fullmatch(name) or name != part.filename, "unknown-file", "does not belong in a bundle"),
        (part.flag_bits & 1 or part.compress_type not in PACKED, "no-zip", "is encrypted or oddly compressed"),
        (part.file_size > LARGEST_FILE, "too-large", f"unpacks to {part.file_size:,} bytes"),
    )
    for is_wrong, fault, problem in checks:
        if is_wrong:
            raise BundleError(fault, f"'{ascii(name)[1:-1][:80]}' {problem}")


# Arrays --------------------------------------------------------------------------------------------------------------


def form_of(arrays: Arrays) -> Mesh:
    """Return a form of a bundle; raise ``InvalidMesh`` if it is invalid."""
    return Mesh(arrays["vertices"], arrays.get("faces", arrays[FACES]))


def check_arrays(holds: Holds, name: str, arrays: Arrays, scorer: ScorerSpec | None) -> None:
    """Raise :class:`BundleError` for arrays unsafe for the compiled code of a scorer, which does not check bounds."""
    try:
        if holds == "forms":
            is_fine = len(arrays["vertices"]) <= _MOST_VERTICES and bool(form_of(arrays))
        elif holds == "descriptors":
            is_fine = _is_finite(arrays["descriptor"], np.float64) and arrays["descriptor"].ndim == 1
        elif scorer and scorer.base_name == DEFAULT:
            is_fine = len(arrays) == 2 and _are_views(scorer, arrays["descriptors"], arrays["view_offsets"])
        else:
            is_fine = len(arrays) == 1 and _is_finite(arrays["energies"], np.float64)
    except ShapeError as error:
        raise BundleError("bad-form", f"the form of '{name}': {error.problem}", "ask its author") from error
    except (KeyError, TypeError):
        is_fine = False
    if not is_fine:
        raise BundleError("no-arrays", f"the arrays of '{name}' are not {holds}", "ask its author")


def _is_finite(array: NDArray[Any], dtype: type) -> bool:
    return array.dtype == dtype and bool(np.isfinite(array).all())


def _are_views(scorer: ScorerSpec, descriptors: NDArray[Any], offsets: NDArray[Any]) -> bool:
    from retrieval.features import DESCRIPTOR_SIZE

    created: Any = scorer.create()
    return (
        (descriptors.dtype == np.uint8 and descriptors.ndim == 2 and descriptors.shape[1] == DESCRIPTOR_SIZE)
        and (offsets.dtype == np.int32 and offsets.shape == (created.n_views + 1,))
        and bool(offsets[0] == 0 and offsets[-1] == len(descriptors) and (np.diff(offsets) >= 0).all())
    )
