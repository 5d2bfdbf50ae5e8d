"""Depth images in, canonical forms out, all made by one process that loads its model once."""

from __future__ import annotations

import glob
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmark.cli.canonicalise import FormRequest, write_form
from benchmark.depth.frame import FrameFiles
from benchmark.depth.intrinsics import intrinsics_of
from benchmark.depth.reading import READERS, is_depth_file
from benchmark.errors import ConfigurationError, ShapeError
from benchmark.execution.processes.calls import call_apart


@dataclass(frozen=True)
class FrameOptions:
    """Options of the command line about depth images.

    Parameters
    ----------
    intrinsics
        A file, or fx,fy,cx,cy; "" looks beside each image.
    mask
        A file; "" looks beside each image.
    scale
        Units per metre; None takes 1000 for integers and 1 for floats.
    """

    intrinsics: str = ""
    mask: str = ""
    scale: float | None = None

    def __bool__(self) -> bool:
        return bool(self.intrinsics or self.mask or self.scale)

    def files(self, image: Path) -> FrameFiles:
        """Return the files of an image."""
        camera = intrinsics_of(self.intrinsics) if self.intrinsics else None
        return FrameFiles(image, camera, Path(self.mask) if self.mask else None, self.scale)


@dataclass(frozen=True)
class FrameJob:
    """One depth image, and where its form and its picture go; "" for no picture."""

    source: str
    target: str
    picture: str = ""


def is_of_depth(sources: Sequence[Path]) -> bool:
    """Return whether depth images were named: by extension, a folder, or a pattern that matches several files."""
    return len(sources) > 1 or sources[0].suffix.lower() in READERS or sources[0].is_dir() or _is_pattern(sources[0])


def frames_under(source: Path) -> list[Path]:
    """Return the depth images that a file, a folder or a pattern stands for.

    Raises
    ------
    ConfigurationError
        If there is none.
    """
    from benchmark.datasets.depth_folder import DepthFolder
    from benchmark.datasets.folder import folder_dataset

    if source.is_dir():
        dataset = folder_dataset(source)
        if not isinstance(dataset, DepthFolder):
            raise ConfigurationError(f"{source} holds meshes", "name one of them, or make all forms with 'run -d'")
        return [entry.path for entry in dataset.entries if entry.path]
    if _is_pattern(source):
        found = [Path(name) for name in sorted(glob.glob(str(source), recursive=True))]  # noqa: PTH207
        chosen = [path for path in found if is_depth_file(path)]
        if not chosen:
            raise ConfigurationError(f"no depth image matches {source}", f"name files in {', '.join(READERS)}")
        return chosen
    return [source]


def make_forms(
    jobs: Sequence[FrameJob], options: FrameOptions, request: FormRequest, say: Callable[[str], None] = print
) -> int:
    """Write the form of each frame, and its picture, made by one process of their own.

    Parameters
    ----------
    jobs
        The frames.
    options
        What is said of all of them.
    request
        By which method; the limit is that of one frame.
    say
        Told what became of each.

    Returns
    -------
    int
        Number of frames without a form.

    Raises
    ------
    ConfigurationError
        If the method cannot be used, or a file cannot be written.
    ShapeError
        If the only frame cannot be treated.
    """
    shape = f"{jobs[0].source}{f' and {len(jobs) - 1} others' if len(jobs) > 1 else ''}"
    guard = request.guard(shape, "try another image, or correct the method")
    found: int = call_apart(_forms, jobs, options, request, guard=guard, say=say)
    return found


def _forms(jobs: Sequence[FrameJob], options: FrameOptions, request: FormRequest, say: Callable[[str], None]) -> int:
    """Make the forms, here; tell of each, and return how many there are not."""
    from benchmark.depth_forms import form_of_object, method_of_depth

    maker = method_of_depth(request.method, request.plugins)
    failures = 0
    for number, job in enumerate(jobs, 1):
        begun = time.perf_counter()
        place = f"{number} of {len(jobs)}  " if len(jobs) > 1 else ""
        try:
            observed = options.files(Path(job.source)).observe()
            made = form_of_object(observed, maker, Path(job.source).stem, seed=request.seed)
        except ShapeError as error:
            if len(jobs) == 1:
                raise
            failures += 1
            say(f"{place}{job.source}: {error}")
            continue
        seconds = time.perf_counter() - begun
        write_form(Path(job.target), made.form.mesh)
        if job.picture:
            from benchmark.report.pictures.painting import save_png
            from benchmark.report.pictures.sheets import frame_picture

            save_png(frame_picture(made.observed.depths, made.observed.mask, made.form.mesh), Path(job.picture))
        facts = [
            f"{key} {value:.4g}" if isinstance(value, float) else f"{key} {value}"
            for key, value in made.form.notes.items()
        ]
        say(
            f"{place}{job.target}: {len(made.form.vertices)} vertices, {seconds:.2f} s"
            + (f", {', '.join(facts)}" if len(jobs) == 1 else "")
        )
    return failures


def _is_pattern(source: Path) -> bool:
    return not source.exists() and glob.has_magic(str(source))
