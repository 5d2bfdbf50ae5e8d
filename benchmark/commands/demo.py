"""A page to play with: some shapes unfold into their canonical forms, without a run."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from benchmark.api.contracts import Shape
from benchmark.commands.forms import form_maker, form_with_notes, plugins_may_fail
from benchmark.commands.selection import as_paths, as_texts
from benchmark.datasets.catalogue import open_dataset
from benchmark.datasets.mesh_files import read_surface
from benchmark.errors import ConfigurationError, ShapeError, naming_file
from benchmark.files import open_file
from benchmark.geometry.camera import FRONT, Camera
from benchmark.geometry.mesh import Mesh
from benchmark.pipeline.forms import shape_of
from benchmark.pipeline.stages import Arrays
from benchmark.pipeline.surfaces import prepare_mesh
from benchmark.registry import Component, select_one
from benchmark.report.forms import Drawn, drawn_form, drawn_from, turned_to
from benchmark.report.play import PlayGallery, PlayMethod, PlayShape, write_play_page

#: Methods of the page: all are done in seconds.
METHODS = ("classic-mds", "gps", "mesh-unfolding")

#: The data set of the animal, and its two poses: it stands, and it begs.
ANIMALS = "animals"
CAT_POSES = ("cat0", "cat4")

#: Most meshes of a page: each takes some ten seconds.
MOST_MESHES = 40

#: What each page says within so many bytes.
PAGE_TITLE = b"<title>Play with canonical forms</title>"
_HEAD = 1000

WatchedForms = Callable[[Sequence["DemoForm"]], Iterable["DemoForm"]]
"""Wrapper that yields forms one at a time, on demand, to show progress."""


@dataclass(frozen=True)
class DemoShape:
    """A shape of the page.

    Parameters
    ----------
    name, label
        Its name, and that of its subject.
    mesh
        Its surface.
    camera
        The camera that looks at it.
    """

    name: str
    label: str
    mesh: Mesh
    camera: Camera = FRONT


@dataclass(frozen=True)
class DemoForm:
    """The form of a shape by a method, which is to be computed."""

    shape: DemoShape
    method: Component

    def __str__(self) -> str:
        """Return what it is called while it is computed."""
        return f"{self.method.name} of {self.shape.name}"


@dataclass(frozen=True)
class Demo:
    """What :func:`demo` did.

    Parameters
    ----------
    path
        The page.
    problems
        Forms that could not be computed, with the reason.
    """

    path: Path
    problems: tuple[str, ...]


def demo(
    meshes: str | Path | Iterable[str | Path] = (),
    output: str | Path = "demo.html",
    *,
    methods: str | Iterable[str] = (),
    plugins: str | Path | Iterable[str | Path] = (),
    seed: int = 0,
    watched: WatchedForms = iter,
) -> Demo:
    """Write a page on which shapes unfold into their canonical forms by several methods.

    Parameters
    ----------
    meshes
        Mesh files, z up, facing -y; by default a generated cat in two poses. Files whose names
        differ in the number at their end alone show the same subject.
    output
        The page, one file that needs no network.
    methods, plugins
        Names of methods, by default those of :data:`METHODS`; plugin files that may define them.
    seed
        Seed of random choices.
    watched
        Wraps the list of forms while they are computed, to show progress, as ``tqdm`` does.

    Raises
    ------
    ShapeError
        If a mesh cannot be read or prepared; the message names the file.
    ConfigurationError
        If there are too many meshes, a method is unknown or computes no forms of surfaces, or the
        output is a file that is no such page.
    """
    page = Path(output)
    _check_replaceable(page)
    files = as_paths(meshes)
    plugin_files = as_paths(plugins)
    names = as_texts(methods) or METHODS
    components = [_method_of_surfaces(name, plugin_files) for name in names]
    makers = {component.name: form_maker(component) for component in components}
    shapes = _shapes_of_files(files) if files else _animal_in_two_poses()
    prepared = {shape.name: _prepared(shape) for shape in shapes}
    bodies = {
        shape.name: drawn_from(_mesh_of(prepared[shape.name]), shape.camera) for shape in shapes
    }
    drawn = _Drawn(bodies=bodies)

    surface: Shape | None = None
    for wanted in watched(_every_form(shapes, components)):
        if surface is None or surface.identifier != wanted.shape.name:
            # Forms come shape by shape. All methods use the geodesics of the shape, which are
            # forgotten with it, as they need much memory.
            surface = shape_of(prepared[wanted.shape.name], wanted.shape.name, seed)
        try:
            with plugins_may_fail(wanted.method):
                form = form_with_notes(makers[wanted.method.name], surface, {})
        except ShapeError as error:
            drawn.problems.append(f"{wanted}: {error}")
        else:
            drawn.add(wanted, form.mesh)

    title = "Your meshes" if files else "A generated cat"
    write_play_page(page, [_gallery(title, shapes, components, drawn)])
    return Demo(page, tuple(drawn.problems))


def _every_form(shapes: Sequence[DemoShape], components: Sequence[Component]) -> list[DemoForm]:
    """Return the form of each shape by each method, to be computed."""
    wanted: list[DemoForm] = []
    for shape in shapes:
        wanted += [DemoForm(shape, component) for component in components]
    return wanted


@dataclass
class _Drawn:
    """Shapes and forms as the page shows them, each form turned to the first of its subject."""

    bodies: dict[str, Drawn]
    forms: dict[tuple[str, str], Drawn] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)
    _firsts: dict[tuple[str, str], Drawn] = field(default_factory=dict)

    def add(self, wanted: DemoForm, form: Mesh) -> None:
        """Add the form of a shape."""
        shape = wanted.shape
        method = wanted.method.name
        drawn = drawn_form(form, self.bodies[shape.name])
        first = self._firsts.setdefault((shape.label, method), drawn)
        if first is not drawn:
            drawn = turned_to(drawn, first)
        self.forms[shape.name, method] = drawn


def _check_replaceable(page: Path) -> None:
    """Raise ``ConfigurationError`` if a file is there that is no page of this kind."""
    if not page.exists():
        return
    with suppress(OSError), open_file(page) as file:
        if PAGE_TITLE in file.read(_HEAD):
            return
    raise ConfigurationError(f"{page} is another file, which stays", "name a new file with -o")


def _mesh_of(arrays: Arrays) -> Mesh:
    """Return the surface in the arrays of a prepared shape."""
    return Mesh(arrays["vertices"], arrays["faces"])


def _prepared(shape: DemoShape) -> Arrays:
    """Return the prepared surface of a shape; raise ``ShapeError`` if there is none."""
    with naming_file(Path(shape.name)):
        return prepare_mesh(shape.mesh)


def _method_of_surfaces(name: str, plugins: Sequence[Path]) -> Component:
    """Return a method; raise ``ConfigurationError`` if it does not take complete surfaces."""
    component = select_one(name, plugins)
    if "mesh" not in component.info.inputs:
        problem = f"method '{name}' reads depth views, and the page shows complete surfaces"
        raise ConfigurationError(problem, "choose one that reads meshes")
    return component


def _animal_in_two_poses() -> list[DemoShape]:
    """Return a generated cat that stands, and one that begs."""
    dataset = open_dataset(ANIMALS)
    return [
        DemoShape(entry.identifier, entry.subject, dataset.load(entry), dataset.camera(entry))
        for entry in dataset.shapes
        if entry.identifier in CAT_POSES
    ]


def _shapes_of_files(paths: Sequence[Path]) -> list[DemoShape]:
    """Read mesh files as shapes of a demo.

    A shape is named after its file. Its class is this name without a number at its end:
    ``cat1.off`` and ``cat2.off`` are two poses of one subject.

    Raises
    ------
    ConfigurationError
        If there are more files than the page has room for.
    ShapeError
        If a mesh cannot be read; the message names the file.
    """
    if len(paths) > MOST_MESHES:
        problem = f"these are {len(paths)} meshes, and a page holds {MOST_MESHES}"
        raise ConfigurationError(problem, "name fewer, or run methods on a folder: run -d FOLDER")
    names = [path.stem for path in paths]
    shapes = []
    for path, name in zip(paths, names, strict=True):
        label = re.sub(r"[\W_]*\d+$", "", name) or name
        unique_name = str(path) if names.count(name) > 1 else name
        with naming_file(path):
            shapes.append(DemoShape(unique_name, label, read_surface(path)))
    return shapes


def _gallery(
    title: str, shapes: Sequence[DemoShape], methods: Sequence[Component], drawn: _Drawn
) -> PlayGallery:
    """Return what the page shows: the shapes, and the form that each method made of each.

    The page treats the shape itself as the form of a first method.

    Parameters
    ----------
    title
        Heading of the page.
    shapes, methods
        The shapes and the methods.
    drawn
        The surfaces to draw, of shapes and forms. A form that could not be computed is missing.
    """
    shown_shapes = []
    for shape in shapes:
        body = drawn.bodies[shape.name]
        forms = [drawn.forms.get((shape.name, method.name)) for method in methods]
        shown_shapes.append(
            PlayShape(name=shape.name, label=shape.label, body=body, forms=[body, *forms])
        )
    shown_methods = [PlayMethod(name="identity", title="The shape itself")]
    shown_methods += [
        PlayMethod(name=method.name, title=method.title, sentence=method.summary)
        for method in methods
    ]
    return PlayGallery(title=title, methods=shown_methods, shapes=shown_shapes)
