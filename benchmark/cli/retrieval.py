"""The search behind ``retrieve``, in a process of its own."""

from __future__ import annotations

import time
from pathlib import Path

from benchmark.cli.depth_forms import FrameOptions
from benchmark.cli.options import RunOptions
from benchmark.geometry.mesh import Mesh
from benchmark.pipeline.method_run import MethodRun
from benchmark.pipeline.retrieval import Found, input_for, search


def retrieved(query: Path, k: int, picture: Path | None, frame: FrameOptions, options: RunOptions) -> list[str]:
    """Return the lines that tell what was found.

    Parameters
    ----------
    query
        A depth image or a mesh.
    k
        Shapes that are shown.
    picture
        File of their picture; None for none.
    frame
        What is said of a depth image.
    options
        One method, one data set that was run, and how.

    Raises
    ------
    ConfigurationError
        If the gallery was not run, or method, scorer or data set cannot be used.
    ShapeError
        If the query cannot be treated.
    """
    from benchmark.datasets.catalogue import open_dataset
    from benchmark.depth.reading import READERS
    from benchmark.pipeline.preparation import Preparation
    from benchmark.pipeline.storage.store import Store
    from benchmark.plugins.registry import methods, variant
    from benchmark.protocols.galleries import Gallery
    from benchmark.protocols.models import find_models
    from benchmark.report.content import own_table

    begun = time.perf_counter()
    (name,), (source,) = options.methods, options.datasets
    spec, dataset = variant(name, methods(options.plugins)), open_dataset(source, options.data_root)
    store = Store.open(options.results)
    gallery = Gallery(own_table(dataset.name), source, dataset, dataset.entries, data_root=options.data_root)
    models = find_models(spec, gallery, store.models)
    preparation = Preparation(dataset, input_for(query, dataset, spec), store)
    run = MethodRun(preparation, store, spec, options.seed, models, options.scorer_spec())
    found = search(run, query, frame.files(query) if query.suffix.lower() in READERS else None, source)
    seconds = time.perf_counter() - begun
    if picture:
        _draw(run, found, query, k, picture)
    return [*_table(found, k), _summary(found, seconds)]


def _table(found: Found, k: int) -> list[str]:
    rows = [("rank", "name", "class", "distance")]
    for rank, hit in enumerate(found.hits[:k], 1):
        rows.append((str(rank), hit.entry.identifier, hit.entry.subject, f"{hit.distance:.4g}"))
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]


def _summary(found: Found, seconds: float) -> str:
    made = f", {found.made} made from their forms and kept" if found.made else ""
    read = f"{found.read} signatures read"
    return (
        f"class {found.hits[0].entry.subject}, by a margin of {found.margin:.1%} over the second class; "
        f"{read}{made}, {seconds:.1f} s"
    )


def _draw(run: MethodRun, found: Found, query: Path, k: int, path: Path) -> None:
    from benchmark.report.pictures.painting import save_png
    from benchmark.report.pictures.sheets import retrieved_picture

    panels: list[tuple[str, Mesh | None]] = [(f"query\n{query.name}\n", found.form or found.query.mesh)]
    for rank, hit in enumerate(found.hits[:k], 1):
        text = f"{rank}. {hit.entry.identifier}\n{hit.entry.subject}\n{hit.distance:.4g}"
        panels.append((text, None if run.describes else run.found_form(hit.entry)))
    save_png(retrieved_picture(panels), path)
