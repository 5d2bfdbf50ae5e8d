"""Canonical forms of meshes and depth images: of arrays, of files, and of folders."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from benchmark.commands.form import Form
from benchmark.commands.forms import (
    form_maker,
    form_of_object,
    form_of_surface,
    form_with_notes,
    method_of_depth,
    plugins_may_fail,
)
from benchmark.commands.meshes import as_mesh
from benchmark.datasets.folder import folder_set
from benchmark.datasets.frames import frames_of
from benchmark.datasets.mesh_files import READABLE, read_surface
from benchmark.depth.frame import FrameFiles, ObservedObject
from benchmark.depth.intrinsics import intrinsics_of
from benchmark.depth.reading import EXTENSIONS, is_depth_file
from benchmark.errors import ConfigurationError, ShapeError, check_seed, check_whole, naming_file
from benchmark.geometry.camera import FRONT
from benchmark.pipeline.forms import shape_of
from benchmark.pipeline.views import fit_frame, prepare_view
from benchmark.protocols.models import people_training
from benchmark.registry import Component, select, select_one

#: Fewest vertices to which a surface is simplified: those of a tetrahedron.
_FEWEST_VERTICES = 4


def canonicalise(
    vertices: Any,
    faces: ArrayLike | None = None,
    method: Any = "gps",
    *,
    n_vertices: int = 2000,
    seed: int = 0,
) -> Form:
    """Return the canonical form of a surface, prepared as in a run.

    Cleaned, in one piece, decimated, of unit area.

    Parameters
    ----------
    vertices
        Coordinates, shape (n, 3); or a whole mesh: a ``trimesh.Trimesh``, an Open3D
        ``TriangleMesh``, a ``pymeshlab.Mesh``, a pair of arrays, or the path of a file.
    faces
        Vertex indices of the triangles, shape (m, 3), if the mesh is given by its vertices.
    method
        A name, an object, a class, or a function from a shape to positions.
    n_vertices
        Largest number of vertices of the prepared surface.
    seed
        Seed of random choices.

    Returns
    -------
    Form
        In units of the root of the area. It has the given vertices in their order, unless some were
        removed; then those of the prepared surface, and ``vertex_map``, shape (n,), names the
        nearest given vertex to each. Without a map, forms of other triangles than ``faces`` have
        vertices of their own. A notebook shows it in 3D, ``to_trimesh`` and ``write`` hand it on.

    Raises
    ------
    ShapeError
        If the surface cannot be read or prepared, or the method refuses it.
    ConfigurationError
        If there is no such method, or it computes no forms.
    """
    if isinstance(faces, str) or callable(faces):
        raise ConfigurationError(
            "the faces of a mesh are no method", "name the method: method='gps'"
        )
    check_whole("n_vertices", n_vertices, _FEWEST_VERTICES)
    check_seed(seed)
    maker = form_maker(select([method])[0])
    mesh = as_mesh(vertices, faces)
    name = Path(vertices).stem if isinstance(vertices, str | Path) else "shape"
    return form_of_surface(maker, mesh, name, n_vertices=n_vertices, seed=seed)


def trained_on_people(component: Component) -> str:
    """Return a warning if a model was trained on people only.

    It is "" otherwise, or if the table determines the model.
    """
    if component.missing_packages():
        return ""
    training = people_training(component.create())
    if not training:
        return ""
    return (
        f"its model of training '{training}' was shown people alone: "
        "it turns any other shape into a person"
    )


# Meshes
# ------------------------------------------------------------------------------------------------


def form_of_file(source: Path, method: str, *, plugins: Iterable[Path] = (), seed: int = 0) -> Form:
    """Prepare a mesh as in the benchmark and return its form.

    A method that accepts only views gets the view of a camera in front of the mesh (z up, facing
    -y), in a frame that fits the mesh.

    Parameters
    ----------
    source
        The file.
    method, plugins
        The method; plugins that may define it.
    seed
        Seed of random choices.

    Raises
    ------
    ConfigurationError
        If the method is unknown or has no canonical form.
    ShapeError
        If the mesh cannot be read or processed; the message names the file.
    """
    check_seed(seed)
    component = select_one(method, plugins)
    maker = form_maker(component)
    with naming_file(source):
        mesh = read_surface(source)
        with plugins_may_fail(component):
            if "mesh" in component.info.inputs:
                return form_of_surface(maker, mesh, source.stem, seed=seed)
            arrays = prepare_view(mesh, FRONT, fit_frame(mesh, FRONT))
            return form_with_notes(maker, shape_of(arrays, source.stem, seed), {})


# Depth images
# ------------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class CameraSettings:
    """What is known of the camera of depth images; what is not given comes from files beside them.

    Parameters
    ----------
    intrinsics
        A camera file, or ``fx,fy,cx,cy`` in pixels.
    mask
        File of the mask of the object.
    depth_scale
        Units of depth per metre.
    """

    intrinsics: str = ""
    mask: Path | None = None
    depth_scale: float | None = None

    @property
    def is_given(self) -> bool:
        """Whether anything is given."""
        return bool(self.intrinsics or self.mask or self.depth_scale is not None)

    def of(self, frame: FrameFiles) -> FrameFiles:
        """Return a frame with these settings in place of its own."""
        if self.intrinsics:
            frame = replace(frame, intrinsics=intrinsics_of(self.intrinsics))
        if self.mask:
            frame = replace(frame, mask=self.mask)
        if self.depth_scale is not None:
            frame = replace(frame, scale=self.depth_scale)
        return frame


@dataclass(frozen=True, eq=False)
class FormOfFrame:
    """The form of a depth image, or why there is none.

    Parameters
    ----------
    frame
        The depth image with its camera.
    observed
        The object in it; None without a form.
    form
        The form; None if the image or the method refuses.
    error
        Why there is no form.
    seconds
        Seconds from the files to the form.
    """

    frame: FrameFiles
    observed: ObservedObject | None
    form: Form | None
    error: ShapeError | None
    seconds: float


def is_mesh_file(path: Path) -> bool:
    """Return whether a path is that of a mesh, and not of a depth image or a folder."""
    return path.suffix.lower() not in EXTENSIONS and not path.is_dir()


def frames_of_paths(paths: Sequence[Path], camera: CameraSettings) -> list[FrameFiles]:
    """Return the depth images of files and folders.

    Raises
    ------
    ConfigurationError
        If there is none, or a folder holds meshes.
    """
    chosen = paths
    if len(paths) > 1:  # a pattern expanded by the shell also matches masks and colour images
        chosen = [path for path in paths if not path.is_file() or is_depth_file(path)]
    frames = [*chain.from_iterable(_frames_under(path, camera) for path in chosen)]
    if frames:
        return frames
    if any(path.suffix.lower() in READABLE for path in paths):
        raise ConfigurationError(
            "these are meshes, and several forms are made of depth images alone",
            "name one of them, or make all forms with 'run -d'",
        )
    raise ConfigurationError("none of these files is a depth image", "name 16-bit images")


def _frames_under(source: Path, camera: CameraSettings) -> list[FrameFiles]:
    """Return the depth images of a file or folder.

    Settings replace single ones of the folder's camera.
    """
    if not source.is_dir():
        return [camera.of(FrameFiles(source))]
    dataset = folder_set(source)
    if dataset.observe is None:
        raise ConfigurationError(
            f"{source} holds meshes", "name one of them, or make all forms with 'run -d'"
        )
    return [camera.of(frame) for frame in frames_of(dataset).values()]


def forms_of_frames(
    frames: Sequence[FrameFiles], method: str, *, plugins: Sequence[Path] = (), seed: int = 0
) -> Iterator[FormOfFrame]:
    """Yield the canonical form of the object in each depth image, or why it is refused.

    Parameters
    ----------
    frames
        Depth images, each with its camera and mask.
    method
        Name of a method that accepts views.
    plugins
        Plugin files that may define the method.
    seed
        Seed of all random choices.

    Raises
    ------
    ConfigurationError
        If there is no such method, or it computes no forms from views.
    """
    check_seed(seed)
    component = select_one(method, plugins)
    maker = method_of_depth(method, tuple(plugins))
    for frame in frames:
        start = time.perf_counter()
        # What remains None if the image or the object in it is refused.
        observed: ObservedObject | None = None
        form: Form | None = None
        refused: ShapeError | None = None
        try:
            observed = frame.observe()
            with plugins_may_fail(component):
                form = form_of_object(
                    observed, maker, frame.image.stem, half_width=frame.half_width, seed=seed
                )
        except ShapeError as error:
            refused = error
        yield FormOfFrame(
            frame=frame,
            observed=observed,
            form=form,
            error=refused,
            seconds=time.perf_counter() - start,
        )
