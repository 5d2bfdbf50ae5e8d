"""``canonicalise`` and ``check``: one method at a time."""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from benchmark.cli import completion
from benchmark.cli.options import NOT_OK, OK, PathOption, VertexCount, add_options, timeout_option
from benchmark.errors import ConfigurationError
from benchmark.text import say, say_lines

if TYPE_CHECKING:
    from benchmark.cli.canonicalise import FormRequest
    from benchmark.cli.depth_forms import FrameOptions

#: Characters of a method with its parameters that do not belong into the name of a file.
_NOT_IN_NAMES = r"[^\w.,=()\[\]-]"


@click.command()
@click.option(
    "-m", "--method", "method", required=True, metavar="METHOD", help="Method; see 'list methods'.",
    shell_complete=completion.methods,
)  # fmt: skip
@click.argument("sources", type=PathOption(), metavar="IN...", nargs=-1, required=True)
@click.option(
    "-o",
    "--output",
    type=PathOption(),
    metavar="OUT",
    help="Mesh file [IN-METHOD.off in the current folder], or folder for several images [forms].",
)
@add_options("plugins")
@timeout_option("the form")
@click.option("--seed", type=int, default=0, show_default=True)
@click.option("--vertices", type=VertexCount(), metavar="N|all", help="Number of vertices, or all of the file. [2000]")
@click.option("--intrinsics", default="", metavar="FILE|fx,fy,cx,cy", help="Camera of a depth image. [file next to it]")
@click.option("--mask", type=PathOption(), metavar="FILE", help="Object in a depth image. [found automatically]")
@click.option("--depth-scale", type=float, metavar="N", help="Depth units per metre. [1000 for integers, 1 for floats]")
@click.option(
    "--picture", type=PathOption(), metavar="OUT.png", help="Draw depth and form; for several images, a folder."
)
def canonicalise(
    method: str,
    sources: tuple[Path, ...],
    output: Path | None,
    plugins: tuple[Path, ...],
    timeout: float,
    seed: int,
    vertices: int | str | None,
    intrinsics: str,
    mask: Path | None,
    depth_scale: float | None,
    picture: Path | None,
) -> None:
    """Write the canonical form of a mesh, or of depth images.

    A depth image is a 16-bit PNG or TIFF, NPY, NPZ or PFM; a folder or pattern stands for all of its images.
    """
    from benchmark.cli.canonicalise import FormRequest, canonicalise_file
    from benchmark.cli.depth_forms import FrameOptions, is_of_depth
    from benchmark.cli.description import trained_on_people
    from benchmark.plugins.registry import methods, variant

    for source in sources:
        if not source.name:
            raise ConfigurationError(f"{source} is no file", "name a mesh or a depth image")
    if warning := trained_on_people(variant(method, methods(plugins))):
        say(f"{method}: {warning}", err=True)
    options = FrameOptions(intrinsics, str(mask or ""), depth_scale)
    request = FormRequest(method, plugins, seed, timeout)
    if is_of_depth(sources):
        if vertices is not None:
            raise ConfigurationError("a depth image has no vertices", "omit --vertices")
        _canonicalise_frames(sources, output, request, options, picture)
        return
    if options or picture:
        raise ConfigurationError(
            f"{sources[0]} is no depth image", "leave --intrinsics, --mask, --depth-scale and --picture out"
        )
    target = output or _beside(sources[0], method)
    form = canonicalise_file(sources[0], target, request, vertices)
    facts = ", ".join(
        f"{name} {value:.4g}" if isinstance(value, float) else f"{name} {value}" for name, value in form.notes.items()
    )
    say(f"{target}: {len(form.vertices)} vertices{', ' + facts if facts else ''}")


def _beside(source: Path, method: str) -> Path:
    """The file of a form that has no name; raises ``ConfigurationError`` where it would lie among the data."""
    target = Path(f"{source.stem}-{re.sub(_NOT_IN_NAMES, '_', method)}.off")
    if source.resolve().parent == Path.cwd():
        raise ConfigurationError(
            f"{target} beside {source} would become part of the data", f"name a file with -o, such as -o forms/{target}"
        )
    return target


def _canonicalise_frames(
    sources: tuple[Path, ...], output: Path | None, request: FormRequest, options: FrameOptions, picture: Path | None
) -> None:
    """Write the forms of depth images; exit 1 if one of several has none."""
    from benchmark.cli.depth_forms import FrameJob, frames_under, make_forms
    from benchmark.depth.reading import is_depth_file
    from benchmark.geometry.io import WRITABLE

    if len(sources) > 1:  # a pattern that the shell has replaced matches masks and colours, too
        sources = tuple(path for path in sources if not path.is_file() or is_depth_file(path))
    frames = [frame for source in sources for frame in frames_under(source)]
    if not frames:
        raise ConfigurationError("none of these files is a depth image", "name 16-bit images")
    if frames == list(sources[:1]):
        target = output or _beside(sources[0], request.method)
        if target.suffix.lower() not in WRITABLE:
            raise ConfigurationError(f"{target} is not the name of a mesh file", f"use {', '.join(WRITABLE)}")
        jobs = [FrameJob(str(sources[0]), str(target), str(picture or ""))]
    else:
        folder = output or Path("forms")
        above = os.path.commonpath([path.absolute().parent for path in frames])
        inner = [path.absolute().relative_to(above) for path in frames]
        targets = [str(folder / path.with_suffix(".off")) for path in inner]
        pictures = [str(picture / path.with_suffix(".png")) if picture else "" for path in inner]
        jobs = list(map(FrameJob, map(str, frames), targets, pictures))
    failures = make_forms(jobs, options, request, say)
    if failures:
        say(f"{failures} of {len(jobs)} images have no form", err=True)
        sys.exit(NOT_OK)


@click.command()
@click.argument("target", metavar="METHOD|FILE", shell_complete=completion.methods_or_files)
@click.option("-m", "--method", "chosen", multiple=True, metavar="METHOD", help="Check only this method of a file.")
@click.option("-o", "--option", "options", multiple=True, metavar="NAME=VALUE", help="Option for training a learner.")
@add_options("plugins")
@timeout_option("one check")
def check(
    target: str, chosen: tuple[str, ...], options: tuple[str, ...], plugins: tuple[Path, ...], timeout: float
) -> None:
    """Test the contract of a method, or of everything in a plugin file; exit 1 if it fails.

    Append parameters to either: FILE[power=1].
    """
    from benchmark.api.parameters import assignments
    from benchmark.plugins.conformance import Target, check_apart

    named = Target(target, chosen, tuple(map(str, plugins)), tuple(assignments(options).items()))
    report = check_apart(named, timeout)
    say_lines(str(report))
    sys.exit(OK if report else NOT_OK)
