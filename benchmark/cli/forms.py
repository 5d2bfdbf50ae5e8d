"""``canonicalise`` and ``retrieve``: write and print what the commands return."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from pathlib import Path

from benchmark.api.contracts import CanonicalForm, Input
from benchmark.cli.options import Selection
from benchmark.cli.printing import facts_of
from benchmark.commands.canonicalise import (
    CameraSettings,
    FormOfFrame,
    form_of_file,
    forms_of_frames,
    frames_of_paths,
    is_mesh_file,
    trained_on_people,
)
from benchmark.commands.form import check_writable
from benchmark.datasets.mesh_files import read_mesh
from benchmark.depth.frame import FrameFiles
from benchmark.errors import ConfigurationError
from benchmark.files import write_text
from benchmark.geometry.preparation import prepare
from benchmark.kernel_cache.announcing import announce_compilation
from benchmark.pipeline.surfaces import PREPARED_VERTICES
from benchmark.registry import select_one
from benchmark.report.drawing import check_ending
from benchmark.text import say, say_table


def write_forms(paths: Sequence[Path], method: str, options: Selection, output: Path) -> bool:
    """Write the canonical form of a mesh, or those of the objects in depth images.

    Parameters
    ----------
    paths
        One mesh file, or depth images and folders of them.
    method
        Name of the method.
    options
        Camera, mask, seed and other options.
    output
        File or folder of the forms.

    Returns
    -------
    bool
        Whether the mesh, or each image, has a form.

    Raises
    ------
    ConfigurationError
        If a file is missing, or a mesh is given with a camera.
    """
    announce_compilation()
    _check_are_files(paths)
    warning = trained_on_people(select_one(method, options.plugins))
    if warning:
        say(f"{method}: {warning}", err=True)
    camera = _camera(options)
    source = paths[0]
    are_images = len(paths) > 1 or not is_mesh_file(source)
    if are_images:
        return _write_forms_of_frames(
            frames_of_paths(paths, camera), paths, method, options, output
        )
    if camera.is_given:
        raise ConfigurationError(
            f"{source} is not a depth image", "omit --intrinsics, --mask and --depth-scale"
        )
    _write_form_of_mesh(source, method, options, output)
    return True


def _check_are_files(paths: Sequence[Path]) -> None:
    """Raise ``ConfigurationError`` if there is no such file; of several, one may be missing."""
    for path in paths:
        if not path.name or (len(paths) == 1 and not path.exists()):
            raise ConfigurationError(f"{path} is not a file", "name a mesh or a depth image")


def _write_form_of_mesh(source: Path, method: str, options: Selection, output: Path) -> None:
    """Write the canonical form of a mesh, and print facts about it.

    If its vertices are not those of the mesh, a text file beside it has the number of the nearest
    vertex of the mesh for each vertex of the form.

    Parameters
    ----------
    source
        The mesh.
    method
        Name of the method.
    options
        Seed, plugins, and file of a picture; none is drawn by default.
    output
        File of the form; its extension says the format.

    Raises
    ------
    ConfigurationError
        If the form would replace the mesh.
    """
    _check_targets(output, options.picture)
    _check_replaces_no_input([output], [source])
    form = form_of_file(source, method, plugins=options.plugins, seed=options.seed)
    not_kept = form.write(output)  # what the format cannot hold, in words
    if options.picture is not None:
        _draw_mesh(source, form, options.picture)
    facts = [f"{output}: {len(form.vertices)} vertices", *facts_of(form.notes), *not_kept]
    say(", ".join(facts))
    numbers = output.with_suffix(".vertices.txt")
    if form.vertex_map is None or output.suffix.lower() == ".stl":  # STL has no vertices
        numbers.unlink(missing_ok=True)  # of an earlier form of this name
    else:
        write_text(numbers, "".join(f"{number}\n" for number in form.vertex_map))
        say(
            f"{numbers}: for each vertex of the form, the number of the nearest vertex in "
            f"{source}, counted from 0"
        )


def _camera(options: Selection) -> CameraSettings:
    """Return what the options say of the camera."""
    return CameraSettings(
        intrinsics=options.intrinsics, mask=options.mask, depth_scale=options.depth_scale
    )


def _check_targets(path: Path, picture: Path | None) -> None:
    """Raise ``ConfigurationError`` if a form or picture cannot have a file of this name."""
    check_ending(picture)
    check_writable(path)


def _draw_mesh(source: Path, form: CanonicalForm, picture: Path) -> None:
    """Draw a mesh and its form; the form may have the vertices of the prepared mesh."""
    from benchmark.report import grids, sheets  # matplotlib takes half a second

    mesh = read_mesh(source)
    if mesh.n_vertices != len(form.vertices):
        mesh = prepare(mesh, PREPARED_VERTICES).mesh
    grids.write_figure(sheets.mesh_picture(mesh, form.mesh), picture)


def _check_replaces_no_input(targets: Sequence[Path | None], sources: Sequence[Path]) -> None:
    """Raise ``ConfigurationError`` if a form or picture would be written over a file that is read.

    None in ``targets`` stands for a picture that is not wanted.
    """
    of_sources = {source.resolve(): source for source in sources}
    for target in targets:
        source = of_sources.get(target.resolve()) if target else None
        if source is not None:
            raise ConfigurationError(
                f"{source} would be replaced: it is read", "write to another file or folder"
            )


# Depth images
# ------------------------------------------------------------------------------------------------


def _write_forms_of_frames(
    frames: Sequence[FrameFiles],
    paths: Sequence[Path],
    method: str,
    options: Selection,
    output: Path,
) -> bool:
    """Write the canonical forms of the objects in depth images, and print one line for each.

    If a single image is refused, its error is raised. If one of several is, the others go on.

    Parameters
    ----------
    frames
        The images with their cameras and masks.
    paths
        What the user named: images, or folders of them.
    method
        Name of the method.
    options
        Seed, plugins, and file or folder of pictures.
    output
        File or folder of the forms.

    Returns
    -------
    bool
        Whether each image has a form.
    """
    outputs = _outputs(frames, paths, output, options.picture)
    _check_replaces_no_input([picture for _, picture in outputs], _files_that_are_read(frames))
    forms = forms_of_frames(frames, method, plugins=options.plugins, seed=options.seed)
    if len(frames) == 1:
        (made,) = forms
        if made.error is not None:
            raise made.error
        say(", ".join(_write_form_of_frame(made, *outputs[0])))
        return True
    n_failures = 0
    for number, (made, (file, picture)) in enumerate(zip(forms, outputs, strict=True), 1):
        if made.form is None:
            n_failures += 1
            line = f"{made.frame.image}: {made.error}"
        else:
            first, *facts = _write_form_of_frame(made, file, picture)
            doubts = [fact for fact in facts if fact.startswith("doubt")]
            line = ", ".join([first, *doubts])  # other facts are left out beside many forms
        say(f"{number} of {len(frames)}  {line}")
    if n_failures:
        say(f"{n_failures} of {len(frames)} images have no form", err=True)
    return n_failures == 0


def _write_form_of_frame(of_frame: FormOfFrame, target: Path, picture: Path | None) -> list[str]:
    """Write the form and the picture of a depth image, and return facts about them in words."""
    form = of_frame.form
    if form is None:
        return []
    lost = form.write(target)
    if picture:
        _draw_frame(of_frame, picture)
    first = f"{target}: {len(form.vertices)} vertices, {of_frame.seconds:.2f} s"
    return [first, *facts_of(form.notes), *lost]


def _files_that_are_read(frames: Iterable[FrameFiles]) -> list[Path]:
    """Return the depth images, and the masks of their objects that are files."""
    images = [frame.image for frame in frames]
    masks = [frame.mask_file for frame in frames]
    return [*images, *filter(None, masks)]


def _outputs(
    frames: Sequence[FrameFiles], paths: Sequence[Path], output: Path, picture: Path | None
) -> list[tuple[Path, Path | None]]:
    """Return the paths to which the form and the picture of each image are written.

    Parameters
    ----------
    frames
        The images.
    paths
        What the user named: images, or folders of them.
    output, picture
        Where forms and pictures go; None for no pictures. For one image that the user named, they
        are files. Otherwise they are folders, in which the files have the names and sub-folders of
        the images, such as ``forms/day1/frame3.off`` for ``images/day1/frame3.png``.

    Raises
    ------
    ConfigurationError
        If a folder is needed, and a file is named, or two images would have one file.
    """
    images = [frame.image for frame in frames]
    if len(images) == 1 and images[0] in paths:
        _check_targets(output, picture)
        return [(output, picture)]
    if output.is_file():
        raise ConfigurationError(f"{output} is a file", "name a folder for several forms with -o")
    common_folder = os.path.commonpath([image.absolute().parent for image in images])
    outputs: list[tuple[Path, Path | None]] = []
    for image in images:
        place = image.absolute().relative_to(common_folder)
        picture_of_image = picture / place.with_suffix(".png") if picture else None
        outputs.append((output / place.with_suffix(".off"), picture_of_image))
    _check_different(images, [form for form, _ in outputs])
    return outputs


def _check_different(images: Sequence[Path], forms: Sequence[Path]) -> None:
    """Raise ``ConfigurationError`` if the forms of two images would have one file."""
    image_of: dict[Path, Path] = {}
    for image, form in zip(images, forms, strict=True):
        other = image_of.setdefault(form, image)
        if other != image:
            raise ConfigurationError(
                f"the forms of {other} and {image} would both be {form}",
                "name one of them, or give them other names",
            )


def _draw_frame(of_frame: FormOfFrame, picture: Path) -> None:
    """Draw a depth image, its object and its form."""
    from benchmark.report import grids, sheets

    observed = of_frame.observed
    form = of_frame.form
    if observed and form:
        sheet = sheets.frame_picture(observed.depths, observed.mask, observed.surface, form.mesh)
        grids.write_figure(sheet, picture)


# Retrieval
# ------------------------------------------------------------------------------------------------


def print_matches(
    query: Path, name: str, method: str, options: Selection, count: int, input_: Input | None
) -> None:
    """Print the shapes of a gallery that are nearest to a query.

    Parameters
    ----------
    query
        A mesh file or a depth image.
    name
        Name or folder of the data set in which similar shapes are sought.
    method
        Name of the method.
    options
        Scorer, camera, results folder and other options; a picture is drawn if they name one.
    count
        Number of shapes to print.
    input_
        Whether the gallery is of surfaces or of views; by default like the query.
    """
    from benchmark.commands.retrieve import retrieve  # not imported for canonicalise, which is fast

    announce_compilation()
    check_ending(options.picture)
    _check_replaces_no_input([options.picture], [query, *filter(None, [options.mask])])
    matches = retrieve(
        query,
        name,
        method,
        count=count,
        input=input_,
        scorer=options.scorer,
        plugins=options.plugins,
        results=options.results,
        data_root=options.data_root,
        seed=options.seed,
        gallery_views=options.gallery_views,
        intrinsics=options.intrinsics,
        mask=options.mask,
        depth_scale=options.depth_scale,
    )
    for note in matches.notes:
        say(note, err=True)
    frame = matches.frame
    texts = frame.assign(distance=frame["distance"].map("{:.4g}".format)).astype(str)
    say_table([list(frame.columns), *texts.to_numpy().tolist()])
    if options.picture:
        from benchmark.report import grids

        grids.write_figure(matches.picture(), options.picture)
    say(f"{matches.decision}; {matches.seconds:.1f} s")
