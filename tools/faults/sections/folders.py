"""Bad data sets: a bad shape costs itself alone, and a folder that cannot be used is refused in one line."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmark.datasets.manifest import MANIFEST_FILE
from benchmark.geometry.io import write_mesh
from benchmark.geometry.mesh import Mesh
from tests.toy import RADII, rod
from tools.faults.cases import Border, Case
from tools.faults.scene import INNOCENT, NOT_OK, OK, USAGE, Scene

#: What the bad shape is called; the others are as in the rods.
_BAD = "thin9"

_Vertices = Callable[[np.ndarray], np.ndarray]


def _points(change: _Vertices) -> Callable[[Path], None]:
    """A rod whose vertices were changed."""

    def write(folder: Path) -> None:
        mesh = rod(RADII["thin"], 0.7, rings=14, sides=8)
        lines = ["OFF", f"{mesh.n_vertices} {mesh.n_faces} 0"]
        lines += [" ".join(f"{x:.17g}" for x in vertex) for vertex in change(mesh.vertices.copy())]
        lines += [f"3 {a} {b} {c}" for a, b, c in mesh.faces]
        (folder / f"{_BAD}.off").write_text("\n".join(lines) + "\n")

    return write


def _at(index: int, value: float) -> _Vertices:
    def change(vertices: np.ndarray) -> np.ndarray:
        vertices[index, 1] = value
        return vertices

    return change


def _truncated(suffix: str) -> Callable[[Path], None]:
    def write(folder: Path) -> None:
        whole = folder / f"{_BAD}{suffix}"
        write_mesh(whole, Mesh(*_arrays()))
        content = whole.read_bytes()
        whole.write_bytes(content[: len(content) * 2 // 3])

    return write


def _arrays() -> tuple[np.ndarray, np.ndarray]:
    mesh = rod(RADII["thin"], 0.7, rings=14, sides=8)
    return mesh.vertices, mesh.faces


def _content(name: str, content: bytes) -> Callable[[Path], None]:
    return lambda folder: _ignored((folder / name).write_bytes(content))


def _ignored(_: object) -> None:
    return None


#: Shapes that cannot be processed, or can; whatever becomes of them, the others keep their records.
SHAPES: dict[str, Callable[[Path], None]] = {
    "equal-points": _points(lambda v: np.zeros_like(v)),
    "two-points": _points(lambda v: np.where(np.arange(len(v))[:, None] % 2, 1.0, 0.0) * np.ones(3)),
    "collinear": _points(lambda v: v[:, :1] * [1.0, 2.0, 3.0]),
    "flat": _points(lambda v: v * [1.0, 1.0, 0.0]),
    "huge": _points(lambda v: v * 1e200),
    "too-huge": _points(lambda v: v * 1e308),
    "tiny": _points(lambda v: v * 1e-200),
    "denormal": _points(lambda v: v * 1e-310),
    "far-away": _points(lambda v: v + 1e12),
    "spike": _points(_at(7, 1e6)),
    "long-spike": _points(_at(7, 1e30)),
    "nan": _points(_at(7, float("nan"))),
    "infinite": _points(_at(7, float("inf"))),
    "truncated-off": _truncated(".off"),
    "truncated-obj": _truncated(".obj"),
    "truncated-ply": _truncated(".ply"),
    "truncated-stl": _content(f"{_BAD}.stl", bytes(80) + b"\x10\0\0\0" + bytes(333)),
    "truncated-mat": _content(f"{_BAD}.mat", b"MATLAB 5.0 MAT-file".ljust(124) + b"\0\1IM" + b"\x0f\0\0\0\xff\0\0\0x"),
    "vert-without-tri": _content(f"{_BAD}.vert", b"0 0 0\n1 0 0\n0 1 0\n"),
    "empty-off": _content(f"{_BAD}.off", b""),
    "zeros": _content(f"{_BAD}.ply", bytes(1000)),
    "noise": _content(f"{_BAD}.obj", bytes(range(256)) * 20),
    "announces-much": _content(f"{_BAD}.off", b"OFF\n999999999999 999999999999 0\n0 0 0\n"),
    "announces-much-ply": _content(
        f"{_BAD}.ply",
        b"ply\nformat binary_little_endian 1.0\nelement vertex 99999999999\nproperty float x\nproperty float y\n"
        b"property float z\nelement face 99999999999\nproperty list uchar int vertex_indices\nend_header\n" + bytes(99),
    ),
    "one-triangle": _content(f"{_BAD}.off", b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"),
    "no-faces": _content(f"{_BAD}.off", b"OFF\n3 0 0\n0 0 0\n1 0 0\n0 1 0\n"),
    "face-out-of-range": _content(f"{_BAD}.off", b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 9\n"),
    "negative-face": _content(f"{_BAD}.off", b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 -1\n"),
    "huge-index": _content(f"{_BAD}.off", b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 99999999999999999999\n"),
    "broken-link": lambda folder: (folder / f"{_BAD}.off").symlink_to(folder / "nowhere.off"),
    "link-to-itself": lambda folder: (folder / f"{_BAD}.off").symlink_to(folder / f"{_BAD}.off"),
    "folder-called-mesh": lambda folder: (folder / f"{_BAD}.off").mkdir(),
    "pipe": lambda folder: os.mkfifo(folder / f"{_BAD}.off"),
    "device": lambda folder: (folder / f"{_BAD}.off").symlink_to("/dev/zero"),
    "no-rights": lambda folder: _without_rights(folder / f"{_BAD}.off"),
    "hostile-name": _content("thin\n\x1b[31m|$`<script>9.off", b"OFF\n0 0 0\n"),
    "name-no-text": _content(os.fsdecode(b"thin\xff9.off"), b"OFF\n0 0 0\n"),
    "long-name": _content("thin" + "9" * 240 + ".off", b"OFF\n0 0 0\n"),
    "option-name": _content("-m.off", b"OFF\n0 0 0\n"),
    "two-formats": _content("thin0.obj", b"v 0 0 0\n"),
    "loop-of-folders": lambda folder: (folder / "loop").symlink_to(folder),
}  # fmt: skip


def _manifest(text: str | bytes) -> Callable[[Path], None]:
    content = text if isinstance(text, bytes) else text.encode()
    return lambda folder: _ignored((folder / MANIFEST_FILE).write_bytes(content))


def _without_rights(path: Path) -> None:
    if not path.exists():
        path.write_text("OFF\n")
    path.chmod(0)


def _emptied(folder: Path) -> None:
    for path in folder.iterdir():
        path.unlink()


def _looped(folder: Path) -> None:
    shutil.rmtree(folder)
    folder.symlink_to(folder)


#: What makes a whole folder unusable.
FOLDERS: dict[str, Callable[[Path], None]] = {
    "empty": _emptied,
    "no-rights": lambda folder: folder.chmod(0),
    "loop": _looped,
    "is-a-file": lambda folder: _ignored((shutil.rmtree(folder), folder.write_text(""))),
    "absent": lambda folder: _ignored(shutil.rmtree(folder)),
    "one-class": lambda folder: [path.unlink() for path in folder.glob("thick*")] and None,
    "manifest-empty": _manifest(""),
    "manifest-no-text": _manifest(b"file\tclass\n\xff\xfe\n"),
    "manifest-zeros": _manifest(bytes(100)),
    "manifest-column": _manifest("file\tcolour\nthin0.off\tred\n"),
    "manifest-cells": _manifest("file\tclass\nthin0.off\n"),
    "manifest-twice": _manifest("file\tclass\nthin0.off\ta\nthin0.off\tb\n"),
    "manifest-absent": _manifest("file\tclass\nthin7.off\ta\n"),
    "manifest-outside": _manifest("file\tclass\n../../etc/passwd\ta\n"),
    "manifest-absolute": _manifest("file\tclass\n/etc/passwd\ta\n"),
    "manifest-folder": _manifest("file\tclass\n.\ta\n..\tb\n"),
    "manifest-counts": _manifest("file\tclass\tvertices\nthin0.off\ta\tmany\n"),
    "manifest-zero-byte": _manifest("file\tclass\nthin0\0.off\ta\n"),
    "manifest-is-a-folder": lambda folder: (folder / MANIFEST_FILE).mkdir(),
    "manifest-no-rights": lambda folder: _without_rights(folder / MANIFEST_FILE),
    "manifest-loop": lambda folder: (folder / MANIFEST_FILE).symlink_to(MANIFEST_FILE),
    "cla-empty": _content("a.cla", b""),
    "cla-counts": _content("a.cla", b"PSB 1\n1 99999\n\na 0 9999999999\n0\n"),
    "cla-noise": _content("a.cla", b"PSB 1\n" + bytes(range(256))),
    "cla-two": lambda folder: _ignored([(folder / name).write_text("PSB 1\n") for name in ("a.cla", "b.cla")]),
    "settings-noise": _content("dataset.toml", bytes(range(256))),
    "settings-key": _content("dataset.toml", b"colour = 'red'\n"),
    "settings-type": _content("dataset.toml", b"camera = 1\ncanonical = [[[]]]\n"),
    "settings-deep": _content("dataset.toml", b"a = " + b"[" * 5000 + b"]" * 5000),
    "settings-is-a-folder": lambda folder: (folder / "dataset.toml").mkdir(),
}


def cases() -> list[Case]:
    """One case a bad shape, and one a bad folder."""
    shapes = [Case(f"folders/shape-{name}", lambda s, m=make: _shape(s, m)) for name, make in SHAPES.items()]  # type: ignore[misc]
    return shapes + [Case(f"folders/set-{name}", lambda s, m=make: _folder(s, m)) for name, make in FOLDERS.items()]  # type: ignore[misc]


def _copied(scene: Scene, make: Callable[[Path], None]) -> Path:
    folder = scene.folder / "shapes"
    shutil.copytree(scene.rods, folder)
    make(folder)
    return folder


def _shape(scene: Scene, make: Callable[[Path], None]) -> None:
    """The good shapes are ranked; that the bad one is missing is said, and why."""
    folder = _copied(scene, make)
    good = [path.stem for path in scene.rods.glob("*.off")]
    done = scene.command("run", *scene.selection(INNOCENT, data=folder), "-j", 1, codes=(OK,), ordinary_rights=True)
    record = scene.records().get(INNOCENT)
    if record is None or record["status"] != "ok":
        scene.cross(Border.SPREAD, f"no scores of the good shapes: {done.said.strip()[-300:]}")
    else:
        lost = sorted(set(good) - set(record["shapes"]))
        scene.require(not lost, Border.SPREAD, f"good shapes without a rank: {lost}")
        for shape, reason in record["unsupported"]:
            scene.require(len(reason) > 5, Border.SILENCE, f"{shape}: {reason!r}")
    checked = scene.command("data", "check", folder, ordinary_rights=True)
    scene.require(bool(checked.said.strip()), Border.SILENCE, "data check says nothing")
    scene.command("data", "sheet", folder, "-o", scene.folder / "sheet.png", ordinary_rights=True)
    scene.outcome.tried = 3


def _folder(scene: Scene, make: Callable[[Path], None]) -> None:
    """The folder is refused in one line, or used as if the damage were not there."""
    folder = _copied(scene, make)
    try:
        done = scene.command("run", *scene.selection(INNOCENT, data=folder), "-j", 1, ordinary_rights=True)
        if done.code == OK:
            scene.check_scores(INNOCENT)
        else:
            lines = done.error.strip().splitlines()
            scene.require(
                done.code == USAGE and len(lines) == 1, Border.SILENCE, f"{done.code}: {done.said.strip()[:300]!r}"
            )
        checked = scene.command("data", "check", folder, ordinary_rights=True)
        scene.require(
            done.code == OK or checked.code in (NOT_OK, USAGE), Border.SILENCE, "data check finds nothing wrong"
        )
    finally:
        if folder.is_dir():
            folder.chmod(0o755)
    scene.outcome.tried = 2
