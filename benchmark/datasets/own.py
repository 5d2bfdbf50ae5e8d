"""Data sets of plugin files, as the harness knows every other one."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import Any, cast

from benchmark.api.datasets import DatasetInfo, ListsShapes
from benchmark.api.parameters import parameter_values
from benchmark.arrays import Arrays
from benchmark.datasets.base import Entry
from benchmark.datasets.files import file_digest
from benchmark.errors import BenchmarkError, DatasetError, UnreadableMesh, one_line
from benchmark.execution.processes.process import Process, Requester
from benchmark.geometry.camera import FRONT, Camera
from benchmark.geometry.io import read_mesh
from benchmark.geometry.mesh import Mesh
from benchmark.plugins.closing import facts_of_file, is_closed
from benchmark.plugins.modules import classes_of, import_plugin, sources_of
from benchmark.plugins.services import service
from benchmark.text import LONGEST_NAME, clean, is_name

__all__ = ["OwnDataset", "data_sets_of", "is_own", "open_own", "problems_of", "sources_in"]

#: Between the path of a plugin file and the name of a class in it, where a data set is named by both.
_MARK = ".py:"

#: What facts of plugins call a data set.
KIND = "data set"

#: Characters of the longest identifier, class and pose.
_LONGEST = 200


@dataclass(frozen=True)
class OwnDataset:
    """A data set of a plugin file; see :class:`~benchmark.datasets.base.Dataset`.

    Parameters
    ----------
    made
        What the file makes.
    entries
        Its shapes.
    code
        Path of the file.
    """

    made: ListsShapes
    entries: tuple[Entry, ...]
    code: str

    @cached_property
    def sources(self) -> dict[str, str]:
        """What the plugin consists of."""
        return sources_of(self.code)

    @property
    def files(self) -> dict[str, str]:
        """Files that the plugin has read so far, with their digests."""
        return {}

    @property
    def name(self) -> str:
        """Name on the command line."""
        return self.made.info.name

    @property
    def title(self) -> str:
        """Name in captions."""
        return self.made.info.title

    @property
    def stand_in_for(self) -> str:
        """Nothing."""
        return ""

    @property
    def half_width(self) -> float | None:
        """Half the width of the depth camera's frame."""
        return self.made.info.half_width

    def load(self, entry: Entry) -> Mesh:
        """Make or read the mesh; raises ``UnreadableMesh`` if there is none, whatever its author's code raises."""
        load = getattr(self.made, "load", None)
        if load is None:
            if entry.path is None:
                raise UnreadableMesh(self._said(entry, "has no file"), "give the entry a path, or the class a 'load'")
            return read_mesh(entry.path)
        found = self._asked(load, entry, "load")
        if not isinstance(found, Mesh):
            raise UnreadableMesh(
                self._said(entry, f"'load' returned {type(found).__name__}"), "return Mesh(vertices, faces)"
            )
        return found

    def recipe(self, entry: Entry) -> str:
        """Name of set and shape, parameters, and what the author says or else the digest of the file."""
        told = getattr(self.made, "recipe", None)
        outside = str(self._asked(told, entry, "recipe")) if told else file_digest(entry.path) if entry.path else ""
        return " ".join(filter(None, (self.name, entry.identifier, repr(parameter_values(self.made)), outside)))

    def camera(self, entry: Entry) -> Camera:
        """The depth camera of a shape."""
        chosen = getattr(self.made, "camera", None)
        if chosen is None:
            return FRONT
        found = self._asked(chosen, entry, "camera")
        if not isinstance(found, Camera):
            raise DatasetError(self._said(entry, f"'camera' returned {type(found).__name__}"), "return a Camera")
        return found

    def _asked(self, function: Any, entry: Entry, name: str) -> Any:
        try:
            return function(entry)
        except (BenchmarkError, MemoryError):
            raise
        except Exception as error:
            raise UnreadableMesh(self._said(entry, f"'{name}' raises {one_line(error)}"), "correct the file") from error

    def _said(self, entry: Entry, what: str) -> str:
        return f"data set '{self.name}', shape '{entry.identifier}': {what}"


@dataclass(frozen=True)
class _Told:
    """Facts that a data set in another process has told, and whether it makes meshes rather than naming files."""

    source: str
    info: DatasetInfo
    makes_meshes: bool
    sources: Mapping[str, str]


class _ForeignDataset(OwnDataset):
    """The same for a process that does not import the file: another one lists the shapes and makes the meshes."""

    made: Any

    @classmethod
    def open(cls, source: str) -> _ForeignDataset:
        """Ask for all shapes; see :func:`open_own`."""
        told, _ = _request(source, "open")
        entries = tuple(
            Entry(each["identifier"], each["subject"], each["pose"], Path(each["path"]) if each["path"] else None)
            for each in told["entries"]
        )
        made: Any = _Told(source, DatasetInfo(**told["info"]), told["makes_meshes"], told["sources"])
        return cls(made, entries, source.rpartition(":")[0])

    @cached_property
    def sources(self) -> dict[str, str]:
        """What the plugin consists of."""
        return dict(self.made.sources)

    @property
    def files(self) -> dict[str, str]:
        """Files that the plugin has read so far, with their digests."""
        return _process(self.made.source).files

    def load(self, entry: Entry) -> Mesh:
        """See :meth:`OwnDataset.load`."""
        if not self.made.makes_meshes and entry.path is not None:
            return read_mesh(entry.path)
        found = self._ask("load", entry)[1]
        return Mesh(found["vertices"], found["faces"])

    def recipe(self, entry: Entry) -> str:
        """See :meth:`OwnDataset.recipe`."""
        return str(self._ask("recipe", entry)[0]["recipe"])

    def camera(self, entry: Entry) -> Camera:
        """See :meth:`OwnDataset.camera`."""
        told, _ = self._ask("camera", entry)
        found = Camera(tuple(told["direction"]), tuple(told["up"]))
        object.__setattr__(found, "up", tuple(told["up"]))  # to normalise it once more may cost its last bits
        return found

    def _ask(self, work: str, entry: Entry) -> tuple[Mapping[str, Any], Arrays]:
        return _request(self.made.source, work, entry.identifier)


def _process(source: str) -> Process:
    return service((KIND, source), _serve, {"work": "open", "source": source})


def _request(source: str, work: str, identifier: str = "") -> tuple[Mapping[str, Any], Arrays]:
    return _process(source).request_or_end_alike({"work": work, "source": source, "identifier": identifier})


@cache
def _opened(source: str) -> OwnDataset:
    return open_own(source)


def _serve(asked: Mapping[str, Any], arrays: Arrays, requester: Requester) -> tuple[Mapping[str, Any], Arrays]:
    """Answer what a :class:`_ForeignDataset` asks, in the process of the file."""
    dataset = _opened(asked["source"])
    if asked["work"] == "open":
        entries = [{**asdict(each), "path": str(each.path) if each.path else None} for each in dataset.entries]
        made = dataset.made
        facts = {"info": asdict(made.info), "makes_meshes": hasattr(made, "load"), "sources": dataset.sources}
        return facts | {"entries": entries}, {}
    entry = next(each for each in dataset.entries if each.identifier == asked["identifier"])
    if asked["work"] == "recipe":
        return {"recipe": dataset.recipe(entry)}, {}
    if asked["work"] == "camera":
        return asdict(dataset.camera(entry)), {}
    mesh = dataset.load(entry)
    return {}, {"vertices": mesh.vertices, "faces": mesh.faces}


def is_own(source: str) -> bool:
    """Return whether a data set is named by a plugin file and a class in it."""
    return _MARK in source


def open_own(source: str) -> OwnDataset:
    """Open the data set of a plugin file.

    Parameters
    ----------
    source
        What :func:`data_sets_of` names it by: ``"/path/to/file.py:ClassName"``.

    Raises
    ------
    ConfigurationError
        If the file cannot be imported.
    DatasetError
        If it has no such class, or that lists no shapes as it should.
    """
    if is_closed():
        return _ForeignDataset.open(source)
    path, _, attribute = source.rpartition(":")
    found = getattr(import_plugin(path), attribute, None)
    if not isinstance(getattr(found, "info", None), DatasetInfo):
        raise DatasetError(f"{path} has no data set '{attribute}'", "give the class an 'info: ClassVar[DatasetInfo]'")
    try:
        made: Any = found()  # type: ignore[misc]
        if not isinstance(made, ListsShapes):
            raise DatasetError(f"data set '{made.info.name}' has no 'entries'", "write a method that lists its shapes")
        entries = tuple(made.entries())
    except BenchmarkError:
        raise
    except (Exception, SystemExit) as error:
        raise DatasetError(f"{path}, {attribute} cannot be opened: {one_line(error)}", "correct the file") from error
    for problem, hint in problems_of(entries):
        raise DatasetError(f"data set '{made.info.name}' of {path}: {problem}", hint)
    return OwnDataset(made, entries, path)


def data_sets_of(paths: Iterable[Path]) -> dict[str, str]:
    """Data sets of plugin files: what :func:`open_own` takes, by name.

    Raises
    ------
    ConfigurationError
        If a file cannot be imported.
    DatasetError
        If two sets have one name, or a set says of itself what cannot be.
    """
    found: dict[str, str] = {}
    for path in paths:
        for name, source in _data_sets_in(path):
            if name in found:
                raise DatasetError(f"two data sets are called '{name}': {found[name]} and {path}", "rename one")
            found[name] = source
    return found


def sources_in(path: str) -> dict[str, str]:
    """Return what a plugin file with a data set consists of, by its absolute path."""
    return dict(facts_of_file(path, KIND)[0]["sources"]) if is_closed() else sources_of(path)


def _data_sets_in(path: Path) -> Iterator[tuple[str, str]]:
    if is_closed():
        yield from ((facts["name"], facts["target"]) for facts in facts_of_file(str(path.resolve()), KIND))
        return
    for attribute, info in classes_of(path, DatasetInfo):
        for problem, hint in _problems_of_info(info):
            raise DatasetError(f"plugin {path}, {attribute}: {problem}", hint)
        yield info.name, f"{path.resolve()}:{attribute}"


def problems_of(entries: tuple[Any, ...]) -> Iterator[tuple[str, str]]:
    """Return what is wrong with the shapes that a set lists: each problem with its hint."""
    if not entries:
        yield "it lists no shapes", "let 'entries' list at least two classes, one of them with two shapes"
    for entry in entries:
        if not isinstance(entry, Entry):
            yield f"'entries' lists {type(entry).__name__}", "list Entry(identifier, subject, pose)"
            return
        for field in ("identifier", "subject", "pose"):
            value = getattr(entry, field)
            if not isinstance(value, str) or not 0 < len(value) <= _LONGEST or clean(value) != value:
                yield f"{field} {value!r:.80} is not a text of one line", f"write 1 to {_LONGEST} printable characters"
                return
        if not isinstance(cast(Any, entry.path), Path | None):
            yield f"path of '{entry.identifier}' is {type(entry.path).__name__}", "pass a pathlib.Path"
            return
    twice = [name for name, count in Counter(entry.identifier for entry in entries).items() if count > 1]
    if twice:
        yield f"two shapes are called '{twice[0]}'", "give each shape an identifier of its own"


def _problems_of_info(info: DatasetInfo) -> Iterator[tuple[str, str]]:
    if not is_name(info.name):
        said = f"name {info.name!r:.80} is not lower-case words joined by hyphens"
        yield said, f"write it so, with {LONGEST_NAME} characters at most"
    for field in ("title", "summary"):
        value = getattr(info, field)
        if not isinstance(value, str) or "\n" in value or (field == "title" and not value.strip()):
            yield f"{field} {value!r:.80} is not a text of one line", "write a text"
    width = info.half_width
    if width is not None and (isinstance(width, bool) or not isinstance(width, int | float) or not 0 < width < 1e300):
        yield f"half_width is {width!r}", "write a positive number in units of the meshes, or None"
