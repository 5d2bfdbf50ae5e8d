"""How well the rule that finds the object does on scenes that it was not developed on.

    python -m tools.studies.object_rule [-n 60] [-o docs/images/depth-rule.png]

It was developed on generated humans before one wall, seen by one camera of 640 x 480 pixels. Here are scans of other
bodies and animals, three other cameras, slanted and side walls, tables, chests and rooms without a wall.
"""

from __future__ import annotations

import argparse
import statistics
from pathlib import Path

import numpy as np
from PIL import Image

from benchmark.datasets.animals import Animals
from benchmark.datasets.humans_scanlike import HumansScanlike
from benchmark.depth.errors import DepthError
from benchmark.depth.frame import observe
from benchmark.depth.intrinsics import Intrinsics
from benchmark.depth.planes import background_planes
from benchmark.depth.projection import unprojected
from benchmark.depth.scene import DepthFaults, Pose, Scene
from benchmark.depth.segmentation import find_object, pieces
from benchmark.geometry.mesh import Mesh

CAMERAS = (
    Intrinsics(365.5, 365.5, 256.0, 212.0, (512, 424)),
    Intrinsics(615.0, 615.0, 320.0, 240.0, (640, 480)),
    Intrinsics(640.0, 640.0, 640.0, 360.0, (1280, 720)),
)
#: Length of an animal, in metres, as its longest side.
LENGTHS = (0.6, 1.8)


def box(low, high) -> Mesh:
    """A box between two corners."""
    corners = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)], dtype=float)
    quads = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    faces = [corner for a, b, c, d in quads for corner in ((a, b, c), (a, c, d))]
    return Mesh(np.asarray(low) + corners * np.subtract(high, low), np.array(faces, dtype=np.int32))


def slanted_wall(distance: float, degrees: float) -> Mesh:
    """A wall behind the origin, turned about the vertical."""
    wall = box((-12, distance, -1), (12, distance + 0.1, 6))
    angle = np.radians(degrees)
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    return wall.with_vertices(wall.vertices @ turn.T)


def body(random: np.random.Generator, sets) -> Mesh:
    """A scan of a person, or an animal, on the floor, facing somewhere ahead."""
    dataset = sets[int(random.integers(len(sets)))]
    entry = dataset.entries[int(random.integers(len(dataset.entries)))]
    mesh = dataset.load(entry)
    points = mesh.vertices - (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0)) / 2
    if isinstance(dataset, Animals):
        points *= random.uniform(*LENGTHS) / np.ptp(points, axis=0).max()
        turned = np.radians(90 + random.uniform(-40, 40))
    else:
        turned = np.radians(random.uniform(-40, 40))
    points = points @ np.array([[np.cos(turned), np.sin(turned), 0], [-np.sin(turned), np.cos(turned), 0], [0, 0, 1]])
    return mesh.with_vertices(points - [0, 0, points[:, 2].min()])


def scene(random: np.random.Generator, sets) -> tuple[Scene, Intrinsics]:
    """A scene of one of six kinds, and a camera."""
    made, camera = body(random, sets), CAMERAS[int(random.integers(len(CAMERAS)))]
    kind = int(random.integers(6))
    wall = None if kind in (1, 2) else float(random.uniform(0.8, 3))
    others = {
        1: (slanted_wall(random.uniform(1, 2.5), random.uniform(-35, 35)),),
        3: (box((1.3, -6, -0.5), (1.4, 4, 5)),),  # a side wall
        4: (box((0.9, 0.2, 0.7), (1.9, 0.8, 0.74)),),  # a table
        5: (box((-1.8, 0.3, 0.0), (-1.1, 0.75, 0.9)),),  # a chest
    }.get(kind, ())
    size = np.ptp(made.vertices, axis=0).max()
    distance = float(random.uniform(1.3, 2.6) * max(size, 0.9))
    height = float(random.uniform(0.5, 2.0))
    pose = Pose((random.uniform(-0.4, 0.4), -distance, height), (0, 0, made.vertices[:, 2].max() / 2),
                float(random.uniform(-10, 10)))  # fmt: skip
    return Scene(made, pose, wall, others=others), camera


def overlap(one, other) -> float:
    """Pixels of both as a share of those of either."""
    return float((one & other).sum() / max((one | other).sum(), 1))


def draw(depths, camera, path: Path) -> None:
    """Draw depths, planes, pieces and object side by side."""
    seen = depths > 0
    points = unprojected(depths, camera.rays(*depths.shape[::-1]))
    planes = background_planes(points[::2, ::2], seen[::2, ::2])
    grey = np.where(seen, 0.95 - 0.75 * np.clip(depths / np.percentile(depths[seen], 99), 0, 1), 1.0)
    pictures = [np.repeat(grey[..., None], 3, axis=2) for _ in range(4)]
    free = seen.copy()
    for plane, colour in zip(planes, ((0.3, 0.6, 0.9), (0.4, 0.8, 0.4), (0.9, 0.8, 0.3), (0.8, 0.5, 0.9), (0.6,) * 3),
                             strict=False):  # fmt: skip
        held = seen & plane.holds(points)
        pictures[1][held] = 0.4 * pictures[1][held] + 0.6 * np.array(colour)
        free &= plane.heights(points) > plane.slack(points)
    labels, count = pieces(depths, free)
    colours = np.random.default_rng(3).random((count, 3))
    pictures[2][free] = 0.3 * pictures[2][free] + 0.7 * colours[labels[free]]
    pictures[2][~free] = 0.9
    found = find_object(points, seen, planes)
    pictures[3][~found] = 0.4 + 0.6 * pictures[3][~found]
    pictures[3][found] = np.array([0.95, 0.55, 0.2]) * grey[found][:, None] / grey[found].max()
    row = np.concatenate([np.pad(each, ((0, 0), (0, 12), (0, 0)), constant_values=1.0) for each in pictures], axis=1)
    image = Image.fromarray(np.round(255 * np.clip(row, 0, 1)).astype(np.uint8))
    image.resize((1400, round(1400 * image.height / image.width))).quantize(128).save(path, optimize=True)


def main() -> None:
    """Print the overlaps, and draw one scene where a file is named."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-n", type=int, default=60)
    parser.add_argument("-o", type=Path)
    asked = parser.parse_args()
    sets, found, drawn = (HumansScanlike(), Animals()), [], False
    for number in range(asked.n):
        random = np.random.default_rng([7, number])
        made, camera = scene(random, sets)
        depths, mask = made.drawn(camera, camera.size or (0, 0))
        measured = DepthFaults().perturbed(depths, random)
        try:
            given = observe(measured, camera, half_width=5.0).mask
            found.append(overlap(given, mask & (measured > 0)))
        except DepthError as error:
            print(number, error)
            found.append(0.0)
        if found[-1] < 0.8:
            print(number, camera.size, round(found[-1], 3), made.wall, len(made.others), flush=True)
        if asked.o and not drawn and made.others and camera.size == (640, 480) and found[-1] > 0.9:
            draw(measured, camera, asked.o)
            drawn = True
    quantiles = np.quantile(found, (0.1, 0.25, 0.5))
    print(f"{len(found)} scenes: median overlap {statistics.median(found):.3f}, quartile {quantiles[1]:.3f}, "
          f"decile {quantiles[0]:.3f}, below .8: {sum(each < 0.8 for each in found)}")  # fmt: skip


if __name__ == "__main__":
    main()
