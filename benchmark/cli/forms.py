"""``canonicalise`` and ``retrieve``: forms and nearest shapes of meshes and depth images."""

from __future__ import annotations

import os
import shlex
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from msgspec import structs

from benchmark.api.contracts import CanonicalForm, Input
from benchmark.api.datasets import ShapeSet
from benchmark.api.learning import MeasuresFit
from benchmark.cli.names import trained_on_people
from benchmark.cli.options import Selection
from benchmark.cli.run import planned_jobs
from benchmark.commands.forms import (
    form_maker,
    form_of_object,
    form_of_surface,
    form_with_fit,
    method_of_depth,
    small_for_person,
)
from benchmark.datasets.folder import folder_set
from benchmark.datasets.frames import frame_settings
from benchmark.datasets.mesh_files import WRITABLE, read_mesh, read_surface, write_mesh
from benchmark.depth.frame import HALF_WIDTH, UPRIGHT, FrameFiles
from benchmark.depth.intrinsics import intrinsics_of
from benchmark.depth.reading import EXTENSIONS, is_depth_file
from benchmark.errors import ConfigurationError, ShapeError
from benchmark.files import write_text
from benchmark.geometry.camera import FRONT
from benchmark.geometry.preparation import prepare
from benchmark.pipeline.cache import Arrays, Cache
from benchmark.pipeline.forms import shape_of
from benchmark.pipeline.prepared import PreparedShapes, frame_of
from benchmark.pipeline.search import search
from benchmark.pipeline.stages import require_result
from benchmark.pipeline.surfaces import N_VERTICES, prepare_mesh
from benchmark.pipeline.views import fit_frame, prepare_view
from benchmark.registry import Component, select_one
from benchmark.report.drawing import check_ending
from benchmark.report.forms import Drawn, StoredForms, seen, upright
from benchmark.runs.planning import Planned
from benchmark.text import say, say_table


def canonicalise(paths: Sequence[Path], method: str, options: Selection, output: Path) -> bool:
    """Write the form of a mesh, or the forms of depth images; return whether all could be made."""
    source, *others = paths
    if absent := [
        path for path in paths if not path.name or not (others or path.exists())
    ]:  # of several, one may miss
        raise ConfigurationError(f"{absent[0]} is not a file", "name a mesh or a depth image")
    if warning := trained_on_people(select_one(method, options.plugins)):
        say(f"{method}: {warning}", err=True)
    if others or source.suffix.lower() in EXTENSIONS or source.is_dir():
        return _canonicalise_frames(paths, method, options, output)
    if options.has_camera:
        raise ConfigurationError(
            f"{source} is not a depth image", "omit --intrinsics, --mask and --depth-scale"
        )
    _check_targets(output, options.picture)
    if output.exists() and output.samefile(source):
        raise ConfigurationError(f"{output} is the mesh itself", "name another file with -o")
    try:
        form = form_of_mesh(source, method, options)
    except ShapeError as error:
        raise ShapeError(error.problem, error.hint, error.file or source) from error
    write_mesh(output, form.mesh)
    if options.picture is not None:
        from benchmark.report import figures, sheets  # matplotlib takes half a second

        mesh = read_mesh(source)  # the form may have the vertices of the prepared mesh
        drawn = mesh if mesh.n_vertices == len(form.vertices) else prepare(mesh, N_VERTICES).mesh
        figures.save(sheets.mesh_picture(drawn, form.mesh), options.picture)
    facts = _facts(form.notes)
    if form.vertex_map is not None:
        numbers = output.with_suffix(".vertices.txt")
        write_text(numbers, "".join(f"{number}\n" for number in form.vertex_map))
        facts += [f"the nearest of the file, counted from 0, in {numbers}"]
    say(", ".join([f"{output}: {len(form.vertices)} vertices", *facts]))
    return True


def _check_targets(path: Path, picture: Path | None) -> None:
    """Raise ``ConfigurationError`` if a form or its picture cannot be written to a file of this name."""
    check_ending(picture)
    if path.suffix.lower() not in WRITABLE:
        raise ConfigurationError(
            f"{path} is not the name of a mesh file", f"use {', '.join(WRITABLE)}"
        )


def _facts(notes: Mapping[str, float | str]) -> list[str]:
    unit = dict.fromkeys(("distance", "size"), " m")
    values = {
        n: f"{note:.4g}{unit.get(n, '')}" if isinstance(note, float) else note
        for n, note in notes.items()
    }
    return [
        f"doubt: {value}" if name == "doubt" else f"{name} {value}"
        for name, value in values.items()
    ]


def form_of_mesh(source: Path, method: str, options: Selection) -> CanonicalForm:
    """Prepare a mesh as in the benchmark and return its form.

    A method that accepts only views gets the view of a camera in front of the mesh (z up, facing
    -y), in a frame that fits the mesh.

    Parameters
    ----------
    source
        The file.
    method, options
        The method; plugins that may define it, and the seed.

    Raises
    ------
    ConfigurationError
        If the method is unknown or has no canonical form.
    ShapeError
        If the mesh cannot be read or processed.
    """
    spec = select_one(method, options.plugins)
    maker = form_maker(spec)
    mesh = read_surface(source)
    if "mesh" not in spec.info.inputs:
        arrays = prepare_view(mesh, FRONT, fit_frame(mesh, FRONT))
        return form_with_fit(maker, shape_of(arrays, source.stem, options.seed), {})
    return form_of_surface(maker, mesh, source.stem, seed=options.seed)


# Depth images
# ------------------------------------------------------------------------------------------------


def _frames_under(source: Path, options: Selection) -> list[FrameFiles]:
    """Return the depth images of a file or folder; options replace single settings of the folder's camera."""
    if not source.is_dir():
        return [_with_camera(FrameFiles(source), options)]
    dataset = folder_set(source)
    if dataset.observe is None:
        raise ConfigurationError(
            f"{source} holds meshes", "name one of them, or make all forms with 'run -d'"
        )
    settings = frame_settings(source)
    return [
        _with_camera(FrameFiles(entry.path, **settings), options)
        for entry in dataset.shapes
        if entry.path
    ]


def _with_camera(frame: FrameFiles, options: Selection) -> FrameFiles:
    return replace(
        frame,
        intrinsics=intrinsics_of(options.intrinsics) if options.intrinsics else frame.intrinsics,
        mask=options.mask or frame.mask,
        scale=frame.scale if options.depth_scale is None else options.depth_scale,
    )


def _canonicalise_frames(
    paths: Sequence[Path], method: str, options: Selection, output: Path
) -> bool:
    """Write and report the form and picture of each depth image; return whether all have a form."""
    if len(paths) > 1:  # a pattern expanded by the shell also matches masks and colour images
        paths = [path for path in paths if not path.is_file() or is_depth_file(path)]
    frames = [frame for path in paths for frame in _frames_under(path, options)]
    if not frames:
        raise ConfigurationError("none of these files is a depth image", "name 16-bit images")
    images = [frame.image for frame in frames]
    if images == list(paths[:1]):
        _check_targets(output, options.picture)
        outputs = [(output, options.picture)]
    else:
        if output.is_file():
            raise ConfigurationError(
                f"{output} is a file", "name a folder for several forms with -o"
            )
        above = os.path.commonpath([image.absolute().parent for image in images])
        inner = [image.absolute().relative_to(above) for image in images]
        picture = options.picture
        outputs = [
            (output / p.with_suffix(".off"), picture and picture / p.with_suffix(".png"))
            for p in inner
        ]
    maker = method_of_depth(method, tuple(options.plugins))
    failures = 0
    for number, (frame, (target, picture)) in enumerate(zip(frames, outputs, strict=True), 1):
        start = time.perf_counter()
        count = f"{number} of {len(frames)}  " if len(frames) > 1 else ""
        try:
            observed = frame.observe()
            form = form_of_object(
                observed, maker, frame.image.stem, half_width=frame.half_width, seed=options.seed
            )
        except ShapeError as error:
            if len(frames) == 1:
                raise
            failures += 1
            say(f"{count}{frame.image}: {error}")
            continue
        seconds = time.perf_counter() - start
        write_mesh(target, form.mesh)
        if picture:
            from benchmark.report import figures, sheets

            sheet = sheets.frame_picture(
                observed.depths, observed.mask, observed.surface, form.mesh
            )
            figures.save(sheet, picture)
        facts = [
            fact for fact in _facts(form.notes) if len(frames) == 1 or fact.startswith("doubt")
        ]
        say(", ".join([f"{count}{target}: {len(form.vertices)} vertices, {seconds:.2f} s", *facts]))
    if failures:
        say(f"{failures} of {len(frames)} images have no form", err=True)
    return not failures


# Retrieval
# ------------------------------------------------------------------------------------------------


def retrieve(
    query: Path, name: str, method: str, options: Selection, k: int, wanted: Input | None = None
) -> None:
    """Print the shapes of a gallery, complete surfaces or views, that are nearest to a query."""
    check_ending(options.picture)
    start, component = time.perf_counter(), select_one(method, options.plugins)
    scorer = select_one(options.scorer, options.plugins, "scorer")
    shapes = options.open_dataset(name)
    input_, of_gallery = _inputs(
        query, shapes, component, "view" if options.gallery_views else wanted
    )
    job = _job(name, shapes, component, options, of_gallery)
    itself = [
        entry
        for entry in shapes.shapes
        if entry.path and entry.path.exists() and entry.path.samefile(query)
    ]
    cache, prepared_shapes = Cache(options.results), PreparedShapes(shapes, input_)
    fitted = (
        cache.read("prepared", prepared_shapes.frame_key) if prepared_shapes.frame_key else None
    )
    half_width = (
        float(fitted["half_width"]) if fitted else frame_of(shapes) if input_ == "view" else 0.0
    )
    if (
        itself and not options.has_camera
    ):  # nothing is written, because this process runs the code of plugins
        known = cache.read("prepared", prepared_shapes.key(itself[0])) or prepared_shapes.prepare(
            itself[0], half_width
        )
        arrays = require_result(known)
    else:
        arrays = _query_arrays(query, prepared_shapes, half_width, options, of_gallery=bool(itself))
    shape = shape_of(arrays, query.stem, options.seed)
    maker = _with_model(component, job, [entry.identifier for entry in itself])
    gallery = (job.before or job.record).sides[-1]
    fit = maker.measure_fit(shape) if isinstance(maker, MeasuresFit) else {}
    for doubt in filter(
        None, (small_for_person(shape, maker) if is_depth_file(query) else "", fit.get("doubt"))
    ):
        say(f"{query}: {doubt}", err=True)
    nearest = search(
        options.results,
        gallery,
        shape,
        maker,
        scorer.create(),
        [entry.identifier for entry in itself],
    )
    hits = nearest.hits[:k]
    rows = [
        (str(rank), hit.shape, hit.subject, f"{hit.distance:.4g}")
        for rank, hit in enumerate(hits, 1)
    ]
    say_table([("rank", "name", "class", "distance"), *rows])
    if options.picture:
        from benchmark.report import figures, sheets

        stored, mesh = StoredForms(options.results, options.data_root), shape.mesh
        camera = UPRIGHT if input_ == "view" else shapes.camera(itself[0]) if itself else FRONT
        drawn = upright(nearest.form, seen(mesh, camera)) if nearest.form else seen(mesh, camera)
        panels: list[tuple[str, Drawn | None]] = [(f"query\n{query.name}\n", drawn)]
        for rank, *texts in rows:
            panels.append((f"{rank}. " + "\n".join(texts), stored.upright(gallery, texts[0])))
        figures.save(sheets.retrieved_picture(panels), options.picture)
    if hits[0].distance == 0:
        say(
            f"{hits[0].shape} has the distance 0: the gallery holds the query, or its copy",
            err=True,
        )
    margin = f"a margin of {nearest.margin:.1%} over the second class"
    says = f"class {hits[0].subject}, by {margin}"
    if not nearest.is_decided:
        says = f"undecided: {hits[0].subject} has {margin}, within the range of the scorer's draws"
    say(f"{says}; {time.perf_counter() - start:.1f} s")


def _job(
    name: str, shapes: ShapeSet, component: Component, options: Selection, input_: Input
) -> Planned:
    """Return the finished job of a gallery; raise ``ConfigurationError`` if there is none, or it is of other code."""
    planned = planned_jobs(
        structs.replace(options, datasets=[name], methods=[component.name], input=input_)
    )
    which = (
        f"--gallery-views {options.gallery_views}" if options.gallery_views else f"--input {input_}"
    )
    command = (
        f"run `python -m benchmark run -m {component.name} -d {shlex.quote(name)} {which}` first"
    )
    jobs = [job for job in planned if job.record.sides[-1].gallery == shapes.name]
    if jobs and jobs[0].state == "stale":
        raise ConfigurationError(f"the gallery is stale: {jobs[0].reason}", command)
    if not jobs or jobs[0].state != "finished":
        why = f": {jobs[0].reason}" if jobs else ""
        raise ConfigurationError(
            f"no form of {shapes.name} {input_} {component.name} is kept{why}", command
        )
    return jobs[0]


def _with_model(component: Component, job: Planned, itself: Sequence[str]) -> Any:
    """Return a method with the model that made the forms of a gallery, or of a query that is one of its shapes."""
    of_shape = dict(
        zip(job.record.shapes, job.models, strict=False)
    )  # those of another gallery follow
    models = {of_shape[name] for name in itself} or set(of_shape.values())
    if len(models) > 1:
        problem = f"the forms of {job.record.gallery} are of {len(models)} models, and a query is in no fold"
        raise ConfigurationError(
            problem, "choose one model: -m 'METHOD[training=NAME]'; see 'list models'"
        )
    method, (model,) = component.create(), models
    return method.load(model) if model else method


def _inputs(
    query: Path, shapes: ShapeSet, component: Component, wanted: Input | None
) -> tuple[Input, Input]:
    """Return the inputs of query and gallery: views if either is a depth image, or the method's only input."""
    is_view = query.suffix.lower() in EXTENSIONS or "mesh" not in shapes.inputs or wanted == "view"
    input_: Input = "view" if is_view or "mesh" not in component.info.inputs else "mesh"
    for each in (input_, wanted or input_):
        if each not in component.info.inputs:
            made, what = ("complete surfaces", "views")[:: 1 if each == "view" else -1]
            problem = f"method '{component.name}' needs {made}, and {query} is compared with {what}"
            raise ConfigurationError(problem, f"choose a method that accepts {what}")
    return input_, wanted or input_


def _query_arrays(
    query: Path,
    prepared_shapes: PreparedShapes,
    half_width: float,
    options: Selection,
    *,
    of_gallery: bool,
) -> Arrays:
    """Return the prepared arrays of a mesh or depth image, in the frame of the gallery."""
    if query.suffix.lower() in EXTENSIONS:
        folder = prepared_shapes.shapes.folder
        frame = (
            FrameFiles(query, **frame_settings(folder))
            if of_gallery and folder
            else FrameFiles(query)
        )
        frame = replace(
            _with_camera(frame, options), half_width=prepared_shapes.shapes.half_width or HALF_WIDTH
        )
        return prepare_view(frame.observe().surface, UPRIGHT, frame.half_width)
    if prepared_shapes.input == "mesh":
        return prepare_mesh(read_surface(query))
    return prepare_view(read_surface(query), FRONT, half_width)
