"""The search behind ``retrieve``, in a process of its own."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from benchmark.depth.frame import FrameFiles
from benchmark.depth.intrinsics import intrinsics_of
from benchmark.geometry.mesh import Mesh
from benchmark.jobs.retrieval import Found, GallerySearch, input_for


@dataclass(frozen=True)
class Search:
    """A question in plain values; see :mod:`benchmark.cli.verbs.retrieve`."""

    method: str
    source: str
    query: str
    k: int
    picture: str
    intrinsics: str
    mask: str
    depth_scale: float | None
    scorer: str
    plugins: Sequence[str]
    results: str
    data_root: str
    seed: int

    def plain(self) -> dict[str, Any]:
        """Return the values by name."""
        return asdict(self)

    def frame(self, image: Path) -> FrameFiles:
        """Return the files of the query, where it is a depth image."""
        camera = intrinsics_of(self.intrinsics) if self.intrinsics else None
        return FrameFiles(image, camera, Path(self.mask) if self.mask else None, self.depth_scale)


def retrieved(values: dict[str, Any]) -> list[str]:
    """Return the lines that tell what was found; a picture is written where one is asked for.

    Raises
    ------
    ConfigurationError
        If the gallery was not run, or method, scorer or data set cannot be used.
    ShapeError
        If the query cannot be treated.
    """
    from benchmark.datasets.catalogue import open_dataset
    from benchmark.methods.registry import methods, variant
    from benchmark.methods.scorers import scorer_of, scorers
    from benchmark.protocols.galleries import Gallery
    from benchmark.protocols.models import find_models
    from benchmark.report.content import own_table
    from benchmark.storage.store import Store

    asked = Search(**values)
    begun = time.perf_counter()
    plugins, root = [Path(path) for path in asked.plugins], Path(asked.data_root) if asked.data_root else None
    spec, query = variant(asked.method, methods(plugins)), Path(asked.query)
    dataset, store = open_dataset(asked.source, root), Store.open(Path(asked.results))
    gallery = Gallery(own_table(dataset.name), asked.source, dataset, dataset.entries, data_root=root)
    models = find_models(spec, gallery, store.models)
    input_, scorer = input_for(query, dataset, spec), scorer_of(asked.scorer, scorers(plugins))
    search = GallerySearch(dataset, input_, spec, scorer, store, models, asked.seed, asked.source)
    found = search.search(query, asked.frame)
    seconds = time.perf_counter() - begun
    if asked.picture:
        _draw(search, found, query, asked.k, Path(asked.picture))
    return [*_table(found, asked.k), _summary(found, seconds)]


def _table(found: Found, k: int) -> list[str]:
    rows = [("rank", "name", "class", "distance")]
    for rank, hit in enumerate(found.hits[:k], 1):
        rows.append((str(rank), hit.entry.identifier, hit.entry.subject, f"{hit.distance:.4g}"))
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]


def _summary(found: Found, seconds: float) -> str:
    made = f", {found.made} made from their forms and kept" if found.made else ""
    return (
        f"class {found.hits[0].entry.subject}, by a margin of {found.margin:.1%} over the second class; "
        f"{found.read} signatures read{made}, {seconds:.1f} s"
    )


def _draw(search: GallerySearch, found: Found, query: Path, k: int, path: Path) -> None:
    from benchmark.report.pictures.depth_images import retrieved_picture, save_picture

    panels: list[tuple[str, Mesh | None]] = [(f"query\n{query.name}\n", found.form or found.query.mesh)]
    for rank, hit in enumerate(found.hits[:k], 1):
        text = f"{rank}. {hit.entry.identifier}\n{hit.entry.subject}\n{hit.distance:.4g}"
        panels.append((text, search.form(hit.entry)))
    save_picture(retrieved_picture(panels), path)
