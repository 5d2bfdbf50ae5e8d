"""Forms of frames with missing pixels, beside the rule in README.md.

``python -m results.experiments.depth_frames measure CODE FOLDER [FRAME...]``, in the folder of the
repository, adds the errors of the code that runs, under the name CODE, to depth-frames.csv, and
keeps the forms of undamaged frames in FOLDER; ``judge`` prints what the rule says of ``before`` and
``after``."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas
from PIL import Image
from scipy.spatial import cKDTree

from benchmark.api.contracts import Shape
from benchmark.commands.forms import form_of_object, method_of_depth
from benchmark.datasets.catalogue import open_dataset
from benchmark.depth.frame import HALF_WIDTH, UPRIGHT, observe
from benchmark.depth.intrinsics import Intrinsics, read_intrinsics
from benchmark.depth.reading import Depths, Mask, in_metres, read_mask, read_values
from benchmark.errors import ShapeError
from benchmark.geometry.depth import depth_surface
from benchmark.geometry.mesh import Mesh, Points
from tests.depth.scenes import KINECT, Scene, measured

HERE = Path(__file__).parent
TABLE = HERE / "depth-frames.csv"
EXAMPLES = HERE.parent.parent / "examples" / "depth"

BODIES = "people[draw=0]"
N_BODIES = 10
N_POINTS = 1000
"""Points of the undamaged surface at which two forms are compared."""

EVERY = 20
"""Distance in pixels between lines without a reading; every third one is two pixels wide."""

LOST_AT_RANDOM = 0.3
LOST_BEFORE_RESIZING = 0.05
"""Shares of pixels without a reading."""

FILTERS = {
    "nearest": Image.Resampling.NEAREST,
    "box": Image.Resampling.BOX,
    "bilinear": Image.Resampling.BILINEAR,
    "bicubic": Image.Resampling.BICUBIC,
}
WRONG = 2.0
"""Largest error, as a multiple of that of another measurement of the same frame."""

UNDAMAGED = "none"
AGAINST_TRUTH = "none, against the true depths"
REPEAT = "repeat"
HALVED = "halved"
SCALES = (REPEAT, HALVED, AGAINST_TRUTH)
"""What is no damage, but says how large errors are."""

BEFORE = "before"
AFTER = "after"
CLASSICAL, NETWORK = METHODS = ("classic-mds", "learned-streamed")


class Frame(NamedTuple):
    """Depths in metres with 0 for missing ones, the pixels of the object, and the camera."""

    depths: Depths
    mask: Mask
    camera: Intrinsics


class Seen(NamedTuple):
    """Forms of a frame by method, and the points of its surface in the camera's upright frame in
    metres.
    """

    points: Points
    forms: dict[str, Points]
    notes: dict[str, float | str]


def examples() -> Iterator[tuple[str, Frame]]:
    """Yield the frames of examples/depth."""
    camera = read_intrinsics(EXAMPLES / "camera.json")
    for path in sorted(EXAMPLES.glob("*/*.png")):
        if not path.stem.endswith("_mask"):
            mask = read_mask(path.with_name(f"{path.stem}_mask.png"))
            name = f"{path.parent.name}/{path.stem}"
            yield name, Frame(in_metres(read_values(path)), mask, camera)


def generated(seed: int | None, names: Sequence[str] = ()) -> Iterator[tuple[str, Frame]]:
    """Yield frames of ten bodies in ten poses, or of those named, as a structured-light camera
    measures them.

    Without a seed, all pixels have their true depths.
    """
    shapes = open_dataset(BODIES)
    poses = len({entry.pose for entry in shapes.shapes})
    for number in range(N_BODIES):
        entry = shapes.shapes[number * poses + 2 * number]
        if names and entry.identifier not in names:
            continue
        mesh = shapes.load(entry)
        middle = (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0)) / 2
        lift = np.array([*middle[:2], mesh.vertices[:, 2].min()])
        body = Mesh(mesh.vertices - lift, mesh.faces)
        drawn, mask = Scene((0.2, -2.5, 1.2), body=body).drawn()
        depths = drawn if seed is None else measured(drawn, seed)
        yield entry.identifier, Frame(depths, mask, KINECT)


def halved(frame: Frame, resample: Image.Resampling) -> Frame:
    """Return a frame of half the size as an image program resizes it, missing pixels included."""
    height, width = frame.depths.shape
    size = (width // 2, height // 2)
    image = Image.fromarray(frame.depths.astype(np.float32)).resize(size, resample)
    mask = Image.fromarray(frame.mask).resize(size, Image.Resampling.NEAREST)
    camera = frame.camera
    smaller = Intrinsics(
        camera.fx / 2,
        camera.fy / 2,
        (camera.cx + 0.5) / 2 - 0.5,
        (camera.cy + 0.5) / 2 - 0.5,
        size,
    )
    return Frame(np.maximum(np.array(image, dtype=np.float64), 0), np.array(mask), smaller)


def without_lines(frame: Frame) -> Frame:
    """Return a frame without every twentieth row, and without the row after every sixtieth."""
    rows = np.arange(len(frame.depths))
    lost = (rows % EVERY == 0) | (rows % (3 * EVERY) == 1)
    return frame._replace(depths=np.where(lost[:, None], 0, frame.depths))


def turned(frame: Frame) -> Frame:
    """Return a frame with rows and columns exchanged; its camera is not."""
    return Frame(frame.depths.T, frame.mask.T, frame.camera)


def without_random_pixels(frame: Frame, share: float) -> Frame:
    """Return a frame in which a share of the pixels, drawn at random, has no reading."""
    lost = np.random.default_rng(0).random(frame.depths.shape) < share
    return frame._replace(depths=np.where(lost, 0, frame.depths))


def damaged(frame: Frame) -> Iterator[tuple[str, Frame]]:
    """Yield the damages of a frame by kind."""
    yield HALVED, halved(frame, Image.Resampling.NEAREST)
    yield "rows", without_lines(frame)
    yield "columns", turned(without_lines(turned(frame)))
    yield "random", without_random_pixels(frame, LOST_AT_RANDOM)
    holed = without_random_pixels(frame, LOST_BEFORE_RESIZING)
    for name, resample in FILTERS.items():
        yield f"resized, {name}", halved(holed, resample)
    sparse = np.zeros_like(frame.depths)
    sparse[::2, ::2] = frame.depths[::2, ::2]
    yield "sparse", frame._replace(depths=sparse)


def seen(frame: Frame) -> Seen:
    """Return the forms of a frame; raises ``ShapeError`` if it is refused."""
    observed = observe(frame.depths, frame.camera, frame.mask)
    classical = form_of_object(observed, method_of_depth(CLASSICAL))
    vertices = observed.surface.vertices
    centre = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    view = depth_surface(observed.surface, UPRIGHT, HALF_WIDTH)
    shape = Shape(identifier="", mesh=view.surface, depth=view.depth)
    predicted = method_of_depth(NETWORK).canonicalise(shape)
    forms = {CLASSICAL: classical.vertices, NETWORK: predicted.vertices}
    return Seen(view.surface.vertices + centre, forms, classical.notes)


def errors(undamaged: Seen, other: Seen) -> dict[str, float]:
    """Return the error of the classical form and that of the network's."""
    step = max(1, len(undamaged.points) // N_POINTS)
    _, nearest = cKDTree(other.points).query(undamaged.points[::step])
    true = undamaged.forms[CLASSICAL][::step]
    found = other.forms[CLASSICAL][nearest]
    return {
        CLASSICAL: misfit(true, found),
        NETWORK: apart(undamaged.forms[NETWORK], other.forms[NETWORK]),
    }


def said(of_frame: Seen) -> dict[str, object]:
    """Return what the notes say against a form."""
    return {"pieces": of_frame.notes.get("joined_pieces"), "doubt": of_frame.notes.get("doubt")}


def misfit(true: Points, found: Points) -> float:
    """Return the root mean square distance of two forms after rotation and reflection, over the
    radius of the first.
    """
    true = true - true.mean(axis=0)
    found = found - found.mean(axis=0)
    left, _, right = np.linalg.svd(found.T @ true)
    rest = found @ left @ right - true
    return float(np.sqrt((rest**2).sum() / (true**2).sum()))


def apart(one: Points, other: Points) -> float:
    """Return the mean distance of the points of two forms to the nearest of the other; forms have
    unit area.
    """
    there, _ = cKDTree(other).query(one)
    back, _ = cKDTree(one).query(other)
    return float((there.mean() + back.mean()) / 2)


def measure(code: str, folder: Path, names: Sequence[str]) -> None:
    """Add the errors of frames under all damages to the table.

    Parameters
    ----------
    code
        Name of the code that runs, such as ``"before"``.
    folder
        Folder that keeps the forms of undamaged frames.
    names
        Names of frames; empty for all.
    """
    rows = []
    again = dict(generated(1, names))
    true = dict(generated(None, names))
    for name, frame in (*examples(), *generated(0, names)):
        if names and name not in names:
            continue
        undamaged = seen(frame)
        stem = name.replace("/", "-")
        keep(folder / f"{stem}-{code}.npz", undamaged)
        others = [*damaged(frame)]
        if name in again:
            others = [(REPEAT, again[name]), *others]
        for kind, other in others:
            row: dict[str, object] = {"code": code, "frame": name, "damage": kind}
            try:
                found = seen(other)
            except ShapeError as error:
                row["refused"] = error.problem
            else:
                row |= errors(undamaged, found) | said(found)
            rows.append(row)
            print(row, flush=True)
        if code != BEFORE:
            earlier = kept(folder / f"{stem}-{BEFORE}.npz")
            same = {"code": code, "frame": name, "damage": UNDAMAGED, **said(undamaged)}
            rows.append(same | errors(earlier, undamaged))
            if name in true:
                of_truth = seen(true[name])
                for of_code, form in ((BEFORE, earlier), (code, undamaged)):
                    of_frame = {"code": of_code, "frame": name, "damage": AGAINST_TRUTH}
                    rows.append(of_frame | errors(of_truth, form))
    table = pandas.DataFrame(rows).round(4)
    if TABLE.exists():
        known = pandas.read_csv(TABLE)
        places = ["code", "frame", "damage"]
        table = pandas.concat([known, table]).drop_duplicates(places, keep="last")
    table.to_csv(TABLE, index=False, lineterminator="\n")


def keep(path: Path, frame: Seen) -> None:
    """Write the forms of a frame."""
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez(path, points=frame.points, **frame.forms)


def kept(path: Path) -> Seen:
    """Return the forms that were written."""
    with np.load(path, allow_pickle=False) as arrays:
        return Seen(arrays["points"], {name: arrays[name] for name in METHODS}, {})


def judge() -> None:
    """Print the errors by kind of damage, and what the rule says of each."""
    table = pandas.read_csv(TABLE)
    # A damage is repaired if errors are at most twice those of another measurement of the frame;
    # for resized frames, twice those of halved ones, if these are larger.
    repeat = table[(table["code"] == AFTER) & (table["damage"] == REPEAT)]
    halving = table[(table["code"] == AFTER) & (table["damage"] == HALVED)]
    limit = repeat[[*METHODS]].median()
    limit_of_halved = np.maximum(limit, halving[[*METHODS]].median())
    for kind in dict.fromkeys(table["damage"]):
        of_kind = table[table["damage"] == kind]
        print(f"{kind}:")
        for code, rows in of_kind.groupby("code", sort=False):
            has_form = rows[CLASSICAL].notna()
            is_silent = rows["pieces"].isna() & rows["doubt"].isna()
            wrong = (rows[CLASSICAL] > WRONG * repeat[CLASSICAL].max()) & is_silent
            medians = rows[[*METHODS]].fillna(np.inf).median()
            words = f"refused {(~has_form).sum()}, wrong in silence {wrong.sum()}"
            if kind == UNDAMAGED:
                words += f", moves too far {bool((medians > limit).any())}"
            elif kind not in SCALES:
                floor = limit_of_halved if "resized" in str(kind) else limit
                words += f", repaired {bool((medians <= WRONG * floor).all())}"
            print(f"  {code:6s} {medians[CLASSICAL]:.3f} {medians[NETWORK]:.4f}, {words}")


if __name__ == "__main__":
    what, *rest = sys.argv[1:]
    if what == "measure":
        measure(rest[0], Path(rest[1]), rest[2:])
    else:
        judge()
