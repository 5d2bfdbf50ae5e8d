"""What commands are fed with, and where they run."""

from __future__ import annotations

import runpy
import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from benchmark.geometry.mesh import Mesh
from tests.behaviour.suite import ROOT, call, write_frames
from tests.runs.toy import FAULTS, without_processes
from tests.toy import write_off, write_rods


@pytest.fixture(scope="session")
def material(tmp_path_factory) -> Path:
    """Data and plugins."""
    folder = tmp_path_factory.mktemp("material")
    write_rods(folder / "rods", rings=16, sides=8)
    write_rods(folder / "rods2", rings=16, sides=8)
    write_frames(folder / "frames")
    runpy.run_path(str(ROOT / "examples" / "bent_ellipsoids.py"))["write"](
        folder / "bent-ellipsoids"
    )
    depth = np.load(folder / "frames" / "lean0.npy")
    np.save(folder / "alone.npy", depth)
    Image.fromarray(((depth < 2.5) * 255).astype(np.uint8)).save(folder / "mask.png")
    triangle = Mesh(np.eye(3), [[0, 1, 2]])
    for name in ("bad/dog0", "one/cat0", "one/cat1"):
        write_off(folder / f"{name}.off", triangle)
    (folder / "bad" / "cut0.off").write_text(
        (folder / "bad" / "dog0.off").read_text().replace("1.0", "nan")
    )
    tetrahedron = Mesh(np.eye(4)[:, :3], [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    for name in ("four", "damaged/a0", "damaged/a1", "damaged/b0"):
        write_off(folder / f"{name}.off", tetrahedron)
    (folder / "damaged" / "b1.off").write_text("OFF 1")
    for name in ("empty", "full", "strange", "forced"):
        (folder / name).mkdir()
    (folder / "full" / "mine.txt").write_text("mine")
    for name in ("strange", "forced"):
        (folder / name / "references.bib").write_text("mine")
        (folder / name / "index.html").write_text("mine")
    shutil.copy(FAULTS, folder / "own.py")
    (folder / "syntax.py").write_text("def\n")
    (folder / "examples").symlink_to(ROOT / "examples")
    return folder


@pytest.fixture
def place(material, tmp_path, monkeypatch) -> Path:
    """The current folder, empty but for links to all material, and to the results of today where
    there are some.
    """
    for path in material.iterdir():
        (tmp_path / path.name).symlink_to(path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture(scope="session")
def ran(material) -> Path:
    """The same folder once its data was run, as in processes but in this one."""
    with pytest.MonkeyPatch.context() as patch, without_processes():
        patch.chdir(material)
        for name in ("rods", "frames"):
            suite = ("-m", "gps", "-m", "surface-area", "--results", "results", "-j", 0)
            assert call("run", "-d", name, *suite).code == 0
        own = ("-m", "flat", "-m", "picky", "-m", "bug", "--plugin", "own.py", "--input", "mesh")
        assert call("run", "-d", "rods", *own, "--results", "results", "-j", 2).code == 1
    return material
