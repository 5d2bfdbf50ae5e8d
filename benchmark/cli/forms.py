"""``canonicalise`` and ``retrieve``: write and print what the commands return."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from benchmark.api.contracts import CanonicalForm, Input
from benchmark.cli.options import Selection
from benchmark.cli.printing import facts_of
from benchmark.commands.canonicalise import (
    CameraSettings,
    FormOfFrame,
    depth_frames,
    form_of_file,
    forms_of_frames,
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


def canonicalise(paths: Sequence[Path], method: str, options: Selection, output: Path) -> bool:
    """Write the form of a mesh, or the forms of depth images; return whether all could be made."""
    announce_compilation()
    source, *others = paths
    absent = [path for path in paths if not path.name or not (others or path.exists())]
    if absent:  # of several, one may be missing
        raise ConfigurationError(f"{absent[0]} is not a file", "name a mesh or a depth image")
    if warning := trained_on_people(select_one(method, options.plugins)):
        say(f"{method}: {warning}", err=True)
    camera = _camera(options)
    if others or not is_mesh_file(source):
        return _canonicalise_frames(depth_frames(paths, camera), paths, method, options, output)
    if camera.is_given:
        raise ConfigurationError(
            f"{source} is not a depth image", "omit --intrinsics, --mask and --depth-scale"
        )
    _check_targets(output, options.picture)
    if output.exists() and output.samefile(source):
        raise ConfigurationError(f"{output} is the mesh itself", "name another file with -o")
    form = form_of_file(source, method, plugins=options.plugins, seed=options.seed)
    told = form.write(output)
    if options.picture is not None:
        _draw_mesh(source, form, options.picture)
    facts = [*facts_of(form.notes), *told]
    if form.vertex_map is not None and output.suffix.lower() != ".stl":
        numbers = output.with_suffix(".vertices.txt")
        write_text(numbers, "".join(f"{number}\n" for number in form.vertex_map))
        facts.append(f"the nearest of the file, counted from 0, in {numbers}")
    say(", ".join([f"{output}: {len(form.vertices)} vertices", *facts]))
    return True


def _camera(options: Selection) -> CameraSettings:
    return CameraSettings(
        intrinsics=options.intrinsics, mask=options.mask, depth_scale=options.depth_scale
    )


def _check_targets(path: Path, picture: Path | None) -> None:
    """Raise ``ConfigurationError`` if a form or its picture cannot be written to a file of this name."""
    check_ending(picture)
    check_writable(path)


def _draw_mesh(source: Path, form: CanonicalForm, picture: Path) -> None:
    """Draw a mesh and its form; the form may have the vertices of the prepared mesh."""
    from benchmark.report import grids, sheets  # matplotlib takes half a second

    mesh = read_mesh(source)
    drawn = mesh if mesh.n_vertices == len(form.vertices) else prepare(mesh, PREPARED_VERTICES).mesh
    grids.save(sheets.mesh_picture(drawn, form.mesh), picture)


# Depth images
# ------------------------------------------------------------------------------------------------


def _canonicalise_frames(
    frames: Sequence[FrameFiles],
    paths: Sequence[Path],
    method: str,
    options: Selection,
    output: Path,
) -> bool:
    """Write and report the form and picture of each depth image; return whether all have a form."""
    outputs = _outputs(frames, paths, output, options.picture)
    is_single = len(frames) == 1
    failures = 0
    made = forms_of_frames(frames, method, plugins=options.plugins, seed=options.seed)
    for number, (of_frame, (target, picture)) in enumerate(zip(made, outputs, strict=True), 1):
        count = "" if is_single else f"{number} of {len(frames)}  "
        if of_frame.form is None:
            if is_single and of_frame.error:
                raise of_frame.error
            failures += 1
            say(f"{count}{of_frame.frame.image}: {of_frame.error}")
            continue
        told_of_file = of_frame.form.write(target)
        if picture:
            _draw_frame(of_frame, picture)
        facts = [*facts_of(of_frame.form.notes), *told_of_file]
        shown = facts if is_single else [fact for fact in facts if fact.startswith("doubt")]
        n_vertices = len(of_frame.form.vertices)
        told = f"{count}{target}: {n_vertices} vertices, {of_frame.seconds:.2f} s"
        say(", ".join([told, *shown]))
    if failures:
        say(f"{failures} of {len(frames)} images have no form", err=True)
    return not failures


def _outputs(
    frames: Sequence[FrameFiles], paths: Sequence[Path], output: Path, picture: Path | None
) -> list[tuple[Path, Path | None]]:
    """Return the files of the form and the picture of each image: one file, or those in a folder."""
    images = [frame.image for frame in frames]
    if len(images) == 1 and images[0] in paths:
        _check_targets(output, picture)
        return [(output, picture)]
    if output.is_file():
        raise ConfigurationError(f"{output} is a file", "name a folder for several forms with -o")
    above = os.path.commonpath([image.absolute().parent for image in images])
    inner = [image.absolute().relative_to(above) for image in images]
    return [
        (output / place.with_suffix(".off"), picture and picture / place.with_suffix(".png"))
        for place in inner
    ]


def _draw_frame(of_frame: FormOfFrame, picture: Path) -> None:
    """Draw a depth image, its object and its form."""
    from benchmark.report import grids, sheets

    seen, form = of_frame.observed, of_frame.form
    if seen and form:
        sheet = sheets.frame_picture(seen.depths, seen.mask, seen.surface, form.mesh)
        grids.save(sheet, picture)


# Retrieval
# ------------------------------------------------------------------------------------------------


def retrieve(
    query: Path, name: str, method: str, options: Selection, k: int, wanted: Input | None = None
) -> None:
    """Print the shapes of a gallery, complete surfaces or views, that are nearest to a query."""
    from benchmark.commands.retrieve import retrieve as matches_of  # a form needs no galleries

    check_ending(options.picture)
    matches = matches_of(
        query,
        name,
        method,
        count=k,
        input=wanted,
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

        grids.save(matches.picture(), options.picture)
    say(f"{matches.decision}; {matches.seconds:.1f} s")
