"""Names and sources of data sets."""

from __future__ import annotations

import dataclasses
import difflib
import os
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from benchmark.datasets.base import Dataset, Entry, Part, printable
from benchmark.datasets.jittered import Jittered, clean_name, parsed_jitter
from benchmark.datasets.official import tosca
from benchmark.datasets.official.sets import SETS
from benchmark.datasets.own import data_sets_of, is_own, open_own
from benchmark.datasets.perturbations.dataset import parsed, perturbed_name
from benchmark.errors import ConfigurationError, DatasetError, did_you_mean
from benchmark.plugins.modules import unknown

Loader = Callable[[Path], Dataset]

#: The parametrised humans; see :mod:`benchmark.datasets.humans_gallery`.
PATTERN = re.compile(r"\s*humans\s*\[([^\[\]]*)\]\s*")


@dataclass(frozen=True)
class DatasetSource:
    """A data set with a name on the command line.

    Parameters
    ----------
    summary
        One-line summary for ``list datasets``.
    load
        Function that returns the data set for a data root; generated sets ignore the root.
    n_shapes, n_classes
        Size of the set; ``n_shapes`` is None if no source states it.
    folder
        Folder of an official set under the data root; "" for a generated set.
    origin, url, terms
        Publisher, download address and terms of use of an official set.
    other_use
        Purpose of a set with a single subject, which does not allow retrieval; "" for a set that is ranked.
    """

    summary: str
    load: Loader
    n_shapes: int | None
    n_classes: int
    folder: str = ""
    origin: str = ""
    url: str = ""
    terms: str = ""
    other_use: str = ""

    @property
    def is_shared(self) -> bool:
        """Whether forms of the shapes may be redistributed: only of generated sets; no other terms permit it."""
        return not self.folder


def _official(name: str) -> DatasetSource:
    known = SETS[name]
    layout = known.layout
    size = f"{layout.n_shapes} shapes in" if layout.n_shapes else "shapes in"
    return DatasetSource(
        f"{known.title}, {size} {layout.n_classes} {'class' if layout.n_classes == 1 else 'classes'}",
        lambda root: SETS[name].open(name, root),
        layout.n_shapes,
        layout.n_classes,
        known.folder,
        known.origin,
        known.url,
        known.terms,
        known.other_use,
    )


def _humans(_: Path) -> Dataset:
    from benchmark.datasets.humans import Humans

    return Humans()


def _humans_scanlike(_: Path) -> Dataset:
    from benchmark.datasets.humans_scanlike import HumansScanlike

    return HumansScanlike()


def _people(draw: int) -> Loader:
    def load(_: Path) -> Dataset:
        from benchmark.datasets.people import People

        return People(draw)

    return load


def _animals(_: Path) -> Dataset:
    from benchmark.datasets.animals import Animals

    return Animals()


def _animals_few(root: Path) -> Dataset:
    from benchmark.datasets.perturbations.dataset import Some

    # The classes with at least seven shapes.
    few = Part(subjects=("cat", "david", "dog", "horse", "michael", "victoria"), poses=(0, 2, 4))
    return Some(_animals(root), few, "animals-few", "animals-few (generated, 6 classes x 3 poses)")


CATALOGUE: dict[str, DatasetSource] = {
    "shrec14-synthetic": _official("shrec14-synthetic"),
    "shrec14-real": _official("shrec14-real"),
    "tosca": DatasetSource(
        "TOSCA high resolution, 80 shapes in 9 classes",
        tosca.tosca,
        sum(tosca.CLASS_SIZES.values()),
        len(tosca.CLASS_SIZES),
        "tosca",
        "Technion",
        "http://tosca.cs.technion.ac.il/book/resources_data.html",
        "academic research; cite",
    ),
    "humans": DatasetSource(
        "generated humans, 15 subjects x 20 poses; stand-in for SHREC'14 synthetic", _humans, 300, 15
    ),
    "humans-scanlike": DatasetSource(
        "generated scans of adults, 40 subjects x 10 poses; stand-in for SHREC'14 real", _humans_scanlike, 400, 40
    ),
    "people": DatasetSource(
        "generated humans drawn at random, 15 subjects x 20 poses: the first draw of three", _people(0), 300, 15
    ),
    **{
        f"people[draw={draw}]": DatasetSource(
            f"generated humans drawn at random, 15 subjects x 20 poses, draw {draw}", _people(draw), 300, 15
        )
        for draw in range(3)
    },
    "animals": DatasetSource(
        "generated animals and people, 80 shapes in 9 classes; stand-in for TOSCA", _animals, 80, 9
    ),
    "animals-few": DatasetSource(
        "generated animals and people, 6 classes x 3 poses of the set animals, for the table of robustness",
        _animals_few,
        18,
        6,
    ),
    **{name: _official(name) for name in SETS if not name.startswith("shrec14")},
}


def is_known(name: str) -> bool:
    """Return whether a name on the command line is a data set, with or without parameters, rather than a folder."""
    return name in CATALOGUE or PATTERN.fullmatch(name) is not None


def is_present(name: str, data_root: Path | None) -> bool:
    """Return whether a data set is available: generated sets always, official sets if their folder exists."""
    if (clean := clean_name(name)) != name:
        return is_path(clean) or is_present(clean, data_root)
    if parts := parsed(name):
        return is_path(parts[0]) or is_present(parts[0], data_root)
    source = _source(name)
    return not source.folder or (data_root is not None and (data_root / source.folder).is_dir())


def has_official_sets(data_root: Path) -> bool:
    """Return whether a folder contains an official set."""
    return any((data_root / source.folder).is_dir() for source in CATALOGUE.values() if source.folder)


def open_dataset(name: str, data_root: Path | None) -> Dataset:
    """Open a data set by name or folder path, optionally perturbed or jittered.

    Parameters
    ----------
    name
        A key of :data:`CATALOGUE`, the path of a folder of meshes, or the name of a plugin data set returned by
        :func:`sources`; optionally followed by a perturbation with its strength, ``[noise=3]``, and by the number of a
        jitter, ``[jitter=1]``.
    data_root
        The folder of the official sets; None if there is none.

    Raises
    ------
    ConfigurationError
        If the name is neither a data set nor a folder.
    DatasetError
        If the set is missing or unreadable.
    """
    if jitter := parsed_jitter(name):
        return Jittered(open_dataset(jitter[0], data_root), jitter[1])
    if parts := parsed(name):
        from benchmark.datasets.perturbations.dataset import perturbed

        return perturbed(open_dataset(parts[0], data_root), *parts[1:])
    if is_own(name):
        return open_own(name)
    if not is_known(name) and is_path(name):
        folder = Path(name)
        if not folder.is_dir():
            hint = "name a data set or the folder that holds the meshes"
            beside = [path.name for path in folder.parent.glob("*") if path.is_dir()]
            if folder.is_file():
                hint = f"name the folder that holds it: {folder.parent}"
            elif near := difflib.get_close_matches(folder.name, beside, 1):
                hint = f"did you mean {folder.parent / near[0]}?"
            raise ConfigurationError(f"{folder} is not a folder", hint)
        from benchmark.datasets.folder import folder_dataset

        return dataclasses.replace(folder_dataset(folder), name=folder_name(folder))
    source = _source(name)
    if not is_present(name, data_root):
        where = data_root / source.folder if data_root else f"DATA_ROOT/{source.folder}"
        raise DatasetError(
            f"data set '{name}' is not at {where}",
            f"put it there and pass --data-root; it comes from {source.url}",
        )
    return source.load(data_root or Path())


def catalogued(name: str) -> str | None:
    """Return the catalogue name of the underlying data set, ignoring changes to its shapes; None if there is none.

    A set with parameters keeps its parameters.
    """
    clean = clean_name(name)
    parts = parsed(clean)
    if parts:
        return catalogued(parts[0])
    return clean if is_known(clean) else None


def sources(names: Iterable[str], plugins: Iterable[Path]) -> list[str]:
    """Resolve names on the command line, including data sets of plugin files, to arguments of :func:`open_dataset`.

    Raises
    ------
    ConfigurationError
        If a plugin file is invalid, or a name is neither a data set nor a path.
    DatasetError
        If a plugin data set has the name of another set.
    """
    own = data_sets_of(plugins)
    for name in own:
        if name in CATALOGUE:
            raise DatasetError(f"there is a data set '{name}' already", f"rename the one in {own[name]}")
    return [_meant(name, own) for name in names]


def _meant(name: str, own: Mapping[str, str]) -> str:
    """Resolve a name to an argument of :func:`open_dataset`; ``own`` maps names of plugin data sets to sources."""
    if parts := parsed(name):
        return perturbed_name(_meant(parts[0], own), *parts[1:])
    if name not in own and not is_known(name) and not is_path(name):
        folders = [path.name for path in Path().glob("[!.]*") if path.is_dir()]
        near = difflib.get_close_matches(name, folders, 1)
        raise unknown("data set", name, [*CATALOGUE, *own, *near])
    return own.get(name, name)


def table_name(source: str) -> str:
    """Return the table name of a data set that no table of the paper uses."""
    if source in CATALOGUE:
        return source
    return open_own(source).name if is_own(source) else folder_name(Path(source))


def check_ranked(dataset: Dataset) -> None:
    """Raise ``DatasetError`` for an official set with a single subject, which has another purpose."""
    if dataset.name in CATALOGUE and (use := CATALOGUE[dataset.name].other_use):
        raise DatasetError(f"data set '{dataset.name}' shows one subject, so nothing can be retrieved", use)


def folder_name(folder: Path) -> str:
    """Return the data set name of a folder: its own name, with a suffix if the catalogue uses that name."""
    name = printable(Path(os.path.realpath(folder)).name)  # also names circular links, which are rejected later
    return f"{name}-folder" if name in CATALOGUE else name


def is_path(name: str) -> bool:
    """Return whether a name on the command line is a path."""
    return "/" in name or name.startswith(".") or Path(name).is_dir()


def _source(name: str) -> DatasetSource:
    if PATTERN.fullmatch(name):
        from benchmark.datasets.humans_gallery import HumansGallery

        gallery = HumansGallery.parse(name)
        n_shapes = gallery.subjects * gallery.poses
        return DatasetSource(gallery.title, lambda _: gallery, n_shapes, gallery.subjects)
    if name not in CATALOGUE:
        raise did_you_mean("data set", name, CATALOGUE)
    return CATALOGUE[name]


def canonical_entry(dataset: Dataset, subject: str) -> Entry:
    """Return the shape of a subject in the canonical pose.

    The canonical pose is set in the folder's ``dataset.toml``; otherwise, it is the null pose of the official set or
    the first pose in the order of the data set.

    Parameters
    ----------
    dataset
        The data set.
    subject
        One of its subjects.

    Raises
    ------
    ConfigurationError
        If the data set has no such subject.
    """
    shapes = [entry for entry in dataset.entries if entry.subject == subject]
    if not shapes:
        raise did_you_mean(f"subject of data set '{dataset.name}'", subject, {e.subject for e in dataset.entries})
    pose = getattr(dataset, "canonical_poses", {}).get(subject)
    return next((entry for entry in shapes if entry.pose == pose), shapes[0])
