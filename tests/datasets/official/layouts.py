"""Official sets made up in their layouts and sizes, of tetrahedra no two of which are alike."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from benchmark.datasets.mesh_files import write_mesh
from benchmark.datasets.official import SETS, OfficialSet, members_digest
from benchmark.geometry.mesh import Mesh

#: Sets whose classes stand in a list: number of classes and of shapes in each, name of file, number
#: of the first file.
LISTED = {
    "shrec10": (10, 20, "T{}.off", 0),
    "shrec11": (30, 20, "T{}.off", 0),
    "shrec12-generic": (60, 20, "D{:05d}.off", 1),
    "shrec15": (50, 24, "SHREC15NonRigidTestDB/T{}.off", 1),
    "shrec15-canonical": (10, 10, "{}.obj", 0),
}

CUT = ("cat", "centaur", "david", "dog", "horse", "michael", "victoria", "wolf")

NAMED = {
    "shrec14-synthetic": [f"{i}.obj" for i in range(300)],
    "shrec14-real": [f"{i}.obj" for i in range(400)],
    "shrec07": [f"{i}.off" for i in range(1, 401)],
    "faust": [f"training/registrations/tr_reg_{i:03d}.ply" for i in range(100)],
    "kids": [
        f"{kid}.{kind}.off"
        for kid in ("0001", "0002")
        for kind in ("null.0", *(f"isometry.{i}" for i in range(1, 16)))
    ],
    "topkids": [f"off/kid{i:02d}.off" for i in range(26)],
    "scape": [f"mesh{i:03d}.ply" for i in range(72) if i != 51],
    "shrec16-cuts": [f"cuts_{beast}_shape_{i}.off" for beast in CUT for i in range(1, 4)],
    "shrec16-holes": [f"holes_{beast}_shape_{i}.off" for beast in CUT for i in range(1, 4)],
}


def class_of(number: int, n_classes: int) -> int:
    """Class of a number in the lists made here, which are in no order, as the official ones."""
    return number * 7 % n_classes


def listing(n_classes: int, n_poses: int, first: int = 0) -> dict[str, list[int]]:
    """Numbers of each class."""
    numbers = range(first, first + n_classes * n_poses)
    return {
        f"class{k}": [n for n in numbers if class_of(n, n_classes) == k] for k in range(n_classes)
    }


def cla(classes: dict[str, list[int]]) -> str:
    """A list in the format of the Princeton Shape Benchmark."""
    blocks = [
        f"\n{name} 0 {len(numbers)}\n" + "".join(f"{n}\n" for n in numbers)
        for name, numbers in classes.items()
    ]
    return f"PSB 1\n{len(classes)} {sum(map(len, classes.values()))}\n" + "".join(blocks)


def write_tetrahedron(path: Path, size: float) -> None:
    """Write a small mesh; as text in OFF, the format of thousands of files."""
    if path.suffix == ".off":
        path.write_text(
            f"OFF\n4 4 0\n0 0 0\n{size} 0 0\n0 1 0\n0 0 2\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 2 0 3\n"
        )
        return
    vertices = [[0, 0, 0], [size, 0, 0], [0, 1, 0], [0, 0, 2]]
    write_mesh(path, Mesh(vertices, [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]))


def make(name: str, root: Path) -> Path:
    """Write a set; return its folder."""
    folder = root / SETS[name].folder
    files = NAMED.get(name)
    if files is None:
        n_classes, n_poses, pattern, first = LISTED[name]
        files = [pattern.format(first + i) for i in range(n_classes * n_poses)]
    for place in {(folder / file).parent for file in files}:
        place.mkdir(parents=True)
    for number, file in enumerate(files):
        write_tetrahedron(folder / file, 1 + number / 1000)
    if name in LISTED:
        (folder / "test.cla").write_text(cla(listing(n_classes, n_poses, first)))
    return folder


def with_made_members(known: OfficialSet) -> OfficialSet:
    """The set with the classes of the list made here in place of the official ones."""
    made = listing(known.classes, known.poses)
    return replace(
        known,
        members={members_digest(numbers): f"official-{name}" for name, numbers in made.items()},
    )
