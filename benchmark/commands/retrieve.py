"""The shapes of a finished gallery that are nearest to a mesh or a depth image."""

from __future__ import annotations

import shlex
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmark.api.contracts import Input, Shape
from benchmark.api.datasets import Entry, ShapeSet
from benchmark.commands.canonicalise import CameraSettings
from benchmark.commands.forms import measured_fit, plugins_may_fail, small_for_person
from benchmark.commands.meshes import as_mesh
from benchmark.commands.plan import plan
from benchmark.commands.selection import (
    RESULTS,
    as_paths,
    check_input,
    data_folder,
    further_options,
)
from benchmark.datasets.catalogue import open_dataset
from benchmark.datasets.frames import frames_of
from benchmark.datasets.mesh_files import read_surface
from benchmark.datasets.official import SETS
from benchmark.datasets.settings import with_settings
from benchmark.defaults import DEFAULT_SCORER
from benchmark.depth.frame import HALF_WIDTH, IMAGE_UP, UPRIGHT, FrameFiles
from benchmark.depth.reading import EXTENSIONS, is_depth_file, read_values, usual_scale
from benchmark.errors import ConfigurationError, ShapeError, check_whole, with_hint
from benchmark.geometry.camera import FRONT, Camera
from benchmark.geometry.mesh import Mesh
from benchmark.pipeline.cache import Arrays, Cache
from benchmark.pipeline.forms import shape_of
from benchmark.pipeline.prepared import PreparedShapes, frame_of
from benchmark.pipeline.records import RankedShapes
from benchmark.pipeline.search import SearchResult, search
from benchmark.pipeline.stages import require_result
from benchmark.pipeline.surfaces import prepare_mesh
from benchmark.pipeline.views import prepare_view
from benchmark.registry import Component, select_one
from benchmark.report.forms import Drawn, StoredForms, drawn_form, drawn_from
from benchmark.runs.planning import Planned
from benchmark.text import listed

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame

#: A query that is no shape of the gallery: the settings of its folder name others alone.
_QUERY = Entry("", "", "")

#: A doubt about a new depth image without a floor, in a gallery whose folder states a direction.
_UP_OF_GALLERY = (
    "the image shows no floor, so that its up direction is taken from dataset.toml of the gallery",
    "if the camera was held in another way, take an image that shows the floor",
)

_IN_WORDS: dict[Input, str] = {"mesh": "complete surfaces", "view": "views"}


@dataclass(frozen=True, eq=False, repr=False)
class RetrievedShapes:
    """The shapes of a gallery nearest to a query; a notebook shows them as a table.

    Parameters
    ----------
    query
        The query as the method saw it.
    name
        Name of its file.
    found
        All shapes of the gallery that have a form, nearest first.
    count
        Number of shapes to show.
    gallery
        The gallery.
    camera
        The camera that says which side of the query is up.
    doubts
        What may be wrong with the query.
    results, data_root
        Where the forms of the gallery are stored; folder of the official data sets.
    seconds
        Seconds that the search took.
    """

    query: Shape
    name: str
    found: SearchResult
    count: int
    gallery: RankedShapes
    camera: Camera
    doubts: tuple[str, ...]
    results: Path
    data_root: Path | None
    seconds: float

    def __repr__(self) -> str:
        """Return the name of the query, and its class."""
        return f"RetrievedShapes({self.name!r}, {self.decision})"

    @property
    def frame(self) -> DataFrame:
        """The nearest shapes: ``rank``, ``name``, ``class`` and ``distance``."""
        from pandas import DataFrame

        hits = self.found.hits[: self.count]
        return DataFrame(
            {
                "rank": range(1, len(hits) + 1),
                "name": [hit.shape for hit in hits],
                "class": [hit.subject for hit in hits],
                "distance": [hit.distance for hit in hits],
            }
        )

    @property
    def notes(self) -> list[str]:
        """What may be wrong, in words: doubts about the query, and a copy of it in the gallery."""
        notes = [f"{self.name}: {doubt}" for doubt in self.doubts]
        nearest = self.found.hits[0]
        if nearest.distance == 0:
            notes.append(
                f"{nearest.shape} has the distance 0: the gallery holds the query, or its copy"
            )
        return notes

    @property
    def decision(self) -> str:
        """The class of the nearest shape, and by which margin."""
        label = self.found.hits[0].subject
        margin = f"a margin of {self.found.margin:.1%} over the second class"
        if self.found.is_decided:
            return f"class {label}, by {margin}"
        return f"undecided: {label} has {margin}, within the range of the scorer's draws"

    def picture(self) -> Figure:
        """Draw the form of the query beside the nearest forms of the gallery, with their ranks."""
        from benchmark.report import sheets  # matplotlib takes half a second

        stored = StoredForms(self.results, self.data_root)
        shape = drawn_from(self.query.mesh, self.camera)
        form_of_query = shape
        if self.found.form:
            form_of_query = drawn_form(self.found.form, shape)
        title = f"query\n{Path(self.name).name}"
        panels: list[tuple[str, Drawn | None]] = [(title, form_of_query)]
        for rank, hit in enumerate(self.found.hits[: self.count], 1):
            title = f"{rank}. {hit.shape}\n{hit.subject}\n{hit.distance:.4g}"
            panels.append((title, stored.form_like_shape(self.gallery, hit.shape)))
        return sheets.retrieved_picture(panels)

    def _repr_html_(self) -> str:
        """Show the nearest shapes as a table."""
        return str(self.frame.to_html(index=False)) + f"<p>{self.decision}</p>"


def retrieve(
    query: Any,
    data: str | Path,
    method: str,
    *,
    count: int = 5,
    input: Input | None = None,
    scorer: str = DEFAULT_SCORER,
    plugins: str | Path | Iterable[str | Path] = (),
    results: str | Path = RESULTS,
    data_root: str | Path | None = None,
    seed: int = 0,
    gallery_views: int = 0,
    intrinsics: str = "",
    mask: str | Path | None = None,
    depth_scale: float | None = None,
) -> RetrievedShapes:
    """Return the shapes of a gallery, complete surfaces or views, that are nearest to a query.

    Parameters
    ----------
    query
        File of a mesh or a depth image; or a mesh as :func:`benchmark.canonicalise` takes it.
    data
        Name or folder of the gallery, which a run has ranked by this method and scorer.
    method
        Name of the method.
    count
        Number of shapes to show.
    input
        Input of the gallery; by default that of the query.
    scorer, plugins
        Name of the scorer; plugin files of methods and scorers.
    results, data_root
        The results folder; the folder of the official data sets, by default
        ``CANONICAL_FORMS_DATA``.
    seed
        Base seed.
    gallery_views
        Number of cameras around each shape that show the gallery; 0 for none.
    intrinsics, mask, depth_scale
        Camera of a depth image, as a file or ``"fx,fy,cx,cy"``, its mask, and its units per metre;
        by default from files beside it.

    Raises
    ------
    ConfigurationError
        If no forms of the gallery are kept, they are of other code, or the method does not take the
        input.
    ShapeError
        If the query cannot be read or prepared, or the method refuses it.
    """
    start = time.perf_counter()
    check_input(input)
    check_whole("count", count, 1)
    if gallery_views and input == "mesh":
        raise ConfigurationError(
            "cameras show views of the gallery, and not its surfaces",
            "omit --gallery-views or --input mesh",
        )
    path = Path(query) if isinstance(query, str | Path) else None
    name = "the query" if path is None else str(query)
    files = as_paths(plugins)
    root = data_folder(data_root)
    folder = Path(results)
    component = select_one(method, files)
    scorer_component = select_one(scorer, files, "scorer")
    scoring = scorer_component.create()
    shapes = open_dataset(str(data), root)
    wanted: Input | None = "view" if gallery_views else input
    is_depth = path is not None and path.suffix.lower() in EXTENSIONS
    is_view = is_depth or "mesh" not in shapes.inputs or wanted == "view"
    of_query, of_gallery = _inputs(name, component, wanted, is_view=is_view)
    planned = plan(
        data,
        component.name,
        input=of_gallery,
        scorer=scorer,
        plugins=files,
        results=folder,
        data_root=root,
        seed=seed,
        gallery_views=gallery_views,
    )
    command = ["run", "-m", component.name, "-d", str(data)]
    if gallery_views:
        command += ["--gallery-views", str(gallery_views)]
    else:
        command += ["--input", of_gallery]
    command += further_options(folder, scorer, seed, data_root, files)
    job = _finished(planned.jobs, shapes, component, command, of_gallery)
    gallery = (job.before or job.record).sides[-1]

    itself = [entry for entry in shapes.shapes if path and _is_file(entry, path)]
    without = [entry.identifier for entry in itself]
    known = itself[0] if itself else None
    settings = CameraSettings(
        intrinsics=intrinsics, mask=Path(mask) if mask else None, depth_scale=depth_scale
    )
    prepared = _Prepared(folder, PreparedShapes(shapes, of_query), settings)
    arrays = prepared.of_query(query, path, known)
    shape = shape_of(arrays, path.stem if path else "query", seed)
    maker = _with_model(component, job, without)
    is_image = path is not None and is_depth_file(path)
    with plugins_may_fail(component, scorer_component):
        found = search(folder, gallery, shape, maker, scoring, without)
        doubts = [*prepared.doubts, *_doubts(found, shape, maker, is_image=is_image)]
    camera = UPRIGHT
    if of_query == "mesh":
        camera = shapes.camera(known) if known else _with_query(shapes, shape.mesh).camera(_QUERY)
    return RetrievedShapes(
        shape,
        name,
        found,
        count,
        gallery,
        camera,
        tuple(doubts),
        folder,
        root,
        time.perf_counter() - start,
    )


def _doubts(found: SearchResult, shape: Shape, maker: Any, *, is_image: bool) -> Iterator[str]:
    """Yield what may be wrong with a query: the size of a person, and the fit of its form."""
    small = small_for_person(shape, maker) if is_image else ""
    if small:
        yield small
    fit = {**found.notes, **measured_fit(maker, shape)}
    if fit.get("doubt"):
        yield str(fit["doubt"])


@dataclass(frozen=True)
class _Prepared:
    """Prepares queries as the shapes of a gallery, and keeps doubts about depth images."""

    results: Path
    shapes: PreparedShapes
    camera: CameraSettings
    doubts: list[str] = field(default_factory=list)

    def of_query(self, query: Any, path: Path | None, known: Entry | None) -> Arrays:
        """Return a query: a mesh as another library holds it, a file, or a shape of the gallery."""
        if path is None:
            return self.of_mesh(as_mesh(query))
        if known is None:
            return self.of_file(path)
        return self.of_entry(known, path)

    def of_entry(self, entry: Entry, path: Path) -> Arrays:
        """Return a shape of the gallery.

        Nothing is written, because this process runs the code of plugins.
        """
        if self.camera.is_given:
            return self.of_file(path, entry)
        known = Cache(self.results).read("prepared", self.shapes.key(entry))
        return require_result(known or self.shapes.prepare(entry, self._half_width()))

    def of_file(self, path: Path, known: Entry | None = None) -> Arrays:
        """Return a mesh or depth image, in the frame of the gallery."""
        if path.suffix.lower() in EXTENSIONS:
            return self._of_depth_image(path, known)
        return self.of_mesh(read_surface(path))

    def of_mesh(self, mesh: Mesh) -> Arrays:
        """Return a mesh, or its view in the frame of the gallery, as if it lay in the gallery.

        Raises
        ------
        ConfigurationError
            If a camera is given: a mesh has none.
        """
        if self.camera.is_given:
            raise ConfigurationError(
                "the query is a mesh, not a depth image",
                "omit --intrinsics, --mask and --depth-scale",
            )
        gallery = _with_query(self.shapes.shapes, mesh)
        mesh = gallery.load(_QUERY)
        if self.shapes.input == "mesh":
            return prepare_mesh(mesh)
        return prepare_view(mesh, gallery.camera(_QUERY), self._half_width())

    def _of_depth_image(self, path: Path, known: Entry | None) -> Arrays:
        """Return a depth image, in the frame of the gallery.

        One of the gallery has the camera of its folder. A new one has a camera of its own, but the
        up direction of the folder if it shows no floor.
        """
        gallery = self.shapes.shapes
        frames = frames_of(gallery)
        ups = {frame.up for frame in frames.values()}  # one at most: the folder states it for all
        if known is not None:
            frame = self.camera.of(replace(frames[known.identifier], image=path))
        else:
            frame = self.camera.of(FrameFiles(path, up=next(iter(ups), None)))
            _check_unit(frame, frames.values())
        frame = replace(frame, half_width=gallery.half_width or HALF_WIDTH)
        observed = frame.observe()
        self.doubts.extend(with_hint(what, hint) for what, hint in observed.doubts)
        differs = not np.allclose(frame.up or IMAGE_UP, IMAGE_UP)
        if known is None and observed.notes["up"] == "sidecar" and differs:
            self.doubts.append(with_hint(*_UP_OF_GALLERY))
        return prepare_view(observed.surface, UPRIGHT, frame.half_width)

    def _half_width(self) -> float:
        """Return half the width of the frame that the run fitted; fit it if its file is gone."""
        key = self.shapes.frame_key
        fitted = Cache(self.results).read("prepared", key) if key else None
        if fitted:
            return float(fitted["half_width"])
        if self.shapes.input == "mesh":
            return 0.0
        return frame_of(self.shapes.shapes)


def _with_query(shapes: ShapeSet, mesh: Mesh) -> ShapeSet:
    """Return a gallery with a new mesh, which has the unit, the size and the camera of its shapes.

    These are what the settings of its folder state for shapes that they do not name.
    """
    shapes = shapes.framed or shapes  # views bear other names than the shapes that settings name
    if shapes.folder is None or shapes.observe is not None:
        return replace(shapes, load=lambda _: mesh, camera=lambda _: FRONT)
    official = SETS.get(shapes.name)
    camera = official.camera(_QUERY) if official else FRONT
    return with_settings(replace(shapes, load=lambda _: mesh, camera=lambda _: camera))


def _check_unit(frame: FrameFiles, gallery: Iterable[FrameFiles]) -> None:
    """Raise ``ConfigurationError`` if the unit of a new depth image has to be guessed.

    It has to be if nothing states it, and the images of the gallery have another unit than it would
    be assumed to have.

    Parameters
    ----------
    frame
        The new image.
    gallery
        Images of the gallery.
    """
    if frame.stated_scales:
        return
    scales: set[float] = set()
    for image in gallery:
        with suppress(ShapeError):  # an image that is refused says nothing
            scales.update(image.stated_scales)
    assumed = usual_scale(read_values(frame.image))
    if not scales or assumed in scales:
        return
    units = listed([f"{scale:g}" for scale in sorted(scales)], " or ")
    raise ConfigurationError(
        f"the images of the gallery have {units} units per metre, and nothing states those of"
        f" {frame.image}",
        f"pass --depth-scale; without a statement, it would be {assumed:g}",
    )


def _is_file(entry: Entry, path: Path) -> bool:
    """Return whether a shape is read from a file."""
    if entry.path is None or not (entry.path.exists() and path.exists()):
        return False
    return entry.path.samefile(path)


def _finished(
    planned: Sequence[Planned],
    shapes: ShapeSet,
    component: Component,
    command: Sequence[str],
    input_: Input,
) -> Planned:
    """Return the finished job that made the forms of a gallery.

    Parameters
    ----------
    planned
        Jobs of the gallery, finished or not.
    shapes
        The shapes of the gallery.
    component
        The method.
    command
        Words of the command that computes these forms, for the error.
    input_
        Whether the forms are of surfaces or of views.

    Raises
    ------
    ConfigurationError
        If no job is finished, or code or data have changed since; the error says what to run.
    """
    jobs = [job for job in planned if job.record.sides[-1].gallery == shapes.name]
    job = jobs[0] if jobs else None
    if job is not None and job.state == "finished":
        return job
    hint = f"run `{shlex.join(['python', '-m', 'benchmark', *command])}` first"
    if job is not None and job.state == "stale":
        raise ConfigurationError(f"the gallery is stale: {job.reason}", hint)
    why = f": {job.reason}" if job is not None else ""
    raise ConfigurationError(
        f"no form of {shapes.name} {input_} {component.name} is kept{why}", hint
    )


def _with_model(component: Component, job: Planned, itself: Sequence[str]) -> Any:
    """Return a method with the trained model by which a query is mapped.

    It has to be the model that made the forms of the gallery.

    Parameters
    ----------
    component
        The method.
    job
        The finished job of the gallery, which names the model of each shape.
    itself
        Names of the query in the gallery, whose model is taken; empty for a new query.

    Raises
    ------
    ConfigurationError
        If a new query is compared with forms of several models, such as one for each fold.
    """
    model_of_shape = dict(zip(job.record.shapes, job.models, strict=True))
    models = {model_of_shape[name] for name in itself}
    if not models:
        models = set(model_of_shape.values())
    if len(models) > 1:
        problem = (
            f"the forms of {job.record.gallery} are of {len(models)} models, and a query is in no "
            "fold"
        )
        raise ConfigurationError(
            problem, "choose one model: -m 'METHOD[training=NAME]'; see 'list models'"
        )
    method = component.create()
    model = models.pop()
    if not model:
        return method
    return method.load(model)


def _inputs(
    query: str, component: Component, wanted: Input | None, *, is_view: bool
) -> tuple[Input, Input]:
    """Decide whether query and gallery are compared as surfaces or as depth views.

    The gallery is taken like the query, unless the user wants otherwise.

    Parameters
    ----------
    query
        Name of the query, for the error.
    component
        The method, which accepts surfaces (``"mesh"``), views (``"view"``) or both.
    wanted
        What the user wants for the gallery, if anything.
    is_view
        Whether the query is given as a view.

    Returns
    -------
    of_query, of_gallery : str
        ``"mesh"`` or ``"view"``.

    Raises
    ------
    ConfigurationError
        If the method does not accept the query, or the gallery, in this way.
    """
    # A query that is a surface can be seen as a view, if the method accepts views alone.
    of_query: Input = "mesh"
    if is_view or "mesh" not in component.info.inputs:
        of_query = "view"
    of_gallery = wanted or of_query
    for input_ in (of_query, of_gallery):
        _check_accepts(component, input_, query)
    return of_query, of_gallery


def _check_accepts(component: Component, input_: Input, query: str) -> None:
    """Raise ``ConfigurationError`` if a method does not accept what a query is compared with."""
    if input_ in component.info.inputs:
        return
    accepted = " and ".join(_IN_WORDS[name] for name in component.info.inputs)
    needed = _IN_WORDS[input_]
    problem = f"method '{component.name}' needs {accepted}, and {query} is compared with {needed}"
    raise ConfigurationError(problem, f"choose a method that accepts {needed}")
