"""What the tutorials show runs: their files are executed, and quick commands called."""

from __future__ import annotations

import re
import runpy
import shutil
import sys
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh
from PIL import Image

from benchmark.check import check
from benchmark.datasets.mesh_files import read_mesh
from benchmark.registry import components_named
from tests.pages.blocks import blocks_of
from tests.pages.test_docs import ROOT, TEXTS
from tests.toy import rod
from tests.verbs import call

TUTORIALS = ROOT / "docs" / "tutorials"
KNEELING = ROOT / "examples" / "depth" / "man-1" / "kneeling.png"


def files_of(page):
    """Return the code blocks of a page by the name in their first line, or by their number."""
    blocks = blocks_of(TEXTS[page], "python")
    names = [re.match(r"# (\w+\.py)\n", block) for block in blocks]
    return {
        name[1] if name else str(number): block
        for number, (name, block) in enumerate(zip(names, blocks, strict=True))
    }


@pytest.mark.parametrize(("name", "failing"), [("wrong.py", ["scale"]), ("diffusion.py", [])])
def test_the_spectral_plugin_breaks_the_contract_until_it_has_area_factors(tmp_path, name, failing):
    path = tmp_path / name
    path.write_text(files_of(TUTORIALS / "spectral-plugin.md")[name], encoding="utf-8")
    (component,) = components_named(str(path))
    findings = check(component)
    assert [finding.name for finding in findings if finding.outcome == "failed"] == failing


class Camera:
    """A RealSense that shows nothing in its first second, and then one frame of the examples."""

    def __init__(self) -> None:
        self.n_frames = 0
        lens = {"width": 320, "height": 240, "fx": 262.5, "fy": 262.5, "ppx": 159.5, "ppy": 119.5}
        self.intrinsics = SimpleNamespace(**lens, coeffs=[0.0] * 5)
        self.profile = SimpleNamespace(as_video_stream_profile=lambda: self)

    def start(self):
        sensor = SimpleNamespace(get_depth_scale=lambda: 0.001)
        device = SimpleNamespace(first_depth_sensor=lambda: sensor)
        return SimpleNamespace(get_device=lambda: device)

    def wait_for_frames(self):
        self.n_frames += 1
        return SimpleNamespace(get_depth_frame=lambda: self)

    def get_data(self):
        frame = np.asarray(Image.open(KNEELING))
        return frame if self.n_frames > 30 else np.zeros_like(frame)

    def stop(self):
        pass


def test_the_saved_frame_of_a_realsense_gives_the_form_of_the_example(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, "pyrealsense2", SimpleNamespace(pipeline=Camera))
    script = tmp_path / "save_frame.py"
    script.write_text(files_of(TUTORIALS / "realsense.md")["0"], encoding="utf-8")
    runpy.run_path(str(script))
    shutil.copy(KNEELING.with_name("kneeling_mask.png"), tmp_path / "frame_mask.png")
    vertices = []
    for number, frame in enumerate((tmp_path / "frame.npy", KNEELING)):
        form = tmp_path / f"{number}.off"
        call("canonicalise", "-m", "identity", frame, "-o", form)
        vertices.append(read_mesh(form).vertices)
    assert vertices[0] == pytest.approx(vertices[1], abs=1e-4)


def test_the_page_on_cameras_shows_the_script_of_the_tutorial():
    script = files_of(TUTORIALS / "realsense.md")["0"]
    assert f"```python\n{script}```" in TEXTS[ROOT / "docs" / "how-to" / "depth-camera.md"]


def test_a_folder_of_mixed_formats_has_no_problem(tmp_path):
    names = re.findall(
        r"^(chairs-and-lamps/\S+)$", TEXTS[TUTORIALS / "paper-table.md"], re.MULTILINE
    )
    assert {name.rpartition(".")[2] for name in names} == {"obj", "ply", "stl", "off", "glb"}
    for number, name in enumerate(names):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        mesh = rod(0.1, 0.3 * number)
        trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).export(path)
    told = call("data", "check", tmp_path / "chairs-and-lamps")
    assert "5 shapes" in told or "5 files" in told, told


def test_the_tutorial_shows_the_example_as_it_is():
    example = (ROOT / "examples" / "ray_stretch.py").read_text(encoding="utf-8")
    assert example in files_of(ROOT / "docs" / "start" / "first-method.md").values()
