"""Files and folders that are read: meshes, classes, settings of a set, depth images, cameras."""

import gzip
import json

import numpy as np
import pytest
import trimesh
from PIL import Image
from scipy.io import savemat

from tests.behaviour.suite import call, rod, write_frames, write_off

VERTICES, FACES = rod(0.1, 1.0)


def check(folder, code=0):
    done = call("data", "check", folder)
    assert done.code == code, done.out + done.err
    return " ".join(done.out.split()) + done.err


def test_meshes(tmp_path):
    """One shape in each format, also packed."""
    mesh = trimesh.Trimesh(VERTICES, FACES, process=False)
    for number, kind in enumerate(("off", "obj", "ply", "stl", "glb")):
        mesh.export(tmp_path / f"mesh{number}.{kind}")
    (tmp_path / "mesh5.off.gz").write_bytes(gzip.compress((tmp_path / "mesh0.off").read_bytes()))
    savemat(tmp_path / "mesh6.mat", {"surface": dict(zip("XYZ", VERTICES.T, strict=True)) | {"TRIV": FACES + 1}})
    np.savetxt(tmp_path / "mesh7.vert", VERTICES)
    np.savetxt(tmp_path / "mesh7.tri", FACES + 1, fmt="%d")
    write_off(tmp_path / "rod0.off", *rod(0.1, 0.5))
    report = check(tmp_path)
    assert f"{tmp_path.name}: 9 shapes, 2 classes" in report
    assert "vertices 130 to 130" in report
    assert "faces 256 to 256" in report


def test_classes(tmp_path):
    named, nested, princeton = (tmp_path / name for name in ("named", "nested", "princeton"))
    for number, name in enumerate(("cat0", "cat1", "dog0", "dog1")):
        mesh = rod(0.1, number / 2)
        write_off(named / f"{name}.off", *mesh)
        write_off(nested / name[:3] / f"{number}.off", *mesh)
        write_off(princeton / f"m{number}.off", *mesh)
    (princeton / "x.cla").write_text("PSB 1\n2 4\n\ncat 0 2\n0\n1\n\ndog 0 2\n2\n3\n")
    for folder in (named, nested, princeton):
        assert "cat 2, dog 2" in check(folder)


def test_settings_of_a_set(tmp_path):
    for number, name in enumerate(("cat0", "cat1", "dog0", "dog1")):
        write_off(tmp_path / f"{name}.off", *rod(0.1, 0.5 + number / 2))
    settings = tmp_path / "dataset.toml"
    settings.write_text(
        'canonical_pose = "0"\nup = "y"\nhalf_width = 1.3\nstand_in_for = "tosca"\n[camera]\ncat = "side"\n'
        "dog = { direction = [1, 2, 0] }\n"
    )
    assert "stand-in for tosca" in check(tmp_path)
    for text, named in (("size = 3", "size"), ('up = "x"', "up"), ("half_width = 0", "half_width")):
        settings.write_text(text + "\n")
        report = check(tmp_path, 1)
        assert named in report
        assert "dataset.toml" in report


def test_depth_images(tmp_path):
    write_frames(tmp_path)
    depth = np.load(tmp_path / "lean0.npy").astype(np.float32)
    millimetres = np.round(depth * 1000).astype(np.uint16)
    Image.fromarray(millimetres).save(tmp_path / "lean1.png")
    Image.fromarray(millimetres).save(tmp_path / "lean2.tiff")
    np.savez(tmp_path / "lean3.npz", depth=depth)
    rows, columns = depth.shape
    (tmp_path / "lean4.pfm").write_bytes(f"Pf\n{columns} {rows}\n-1.0\n".encode() + depth[::-1].astype("<f4").tobytes())
    Image.fromarray(((depth < 2.5) * 255).astype(np.uint8)).save(tmp_path / "lean0_mask.png")
    (tmp_path / "lean1.npy").unlink()
    report = check(tmp_path)
    assert "7 shapes, 2 classes" in report
    assert "lean 5, stout 2" in report
    assert "0 errors" in report


CAMERAS = {
    "camera.json": json.dumps(
        {"width": 320, "height": 240, "intrinsic_matrix": [262.5, 0, 0, 0, 262.5, 0, 159.5, 119.5, 1]}
    ),
    "camera_info.yaml": "image_width: 320\nimage_height: 240\ncamera_matrix:\n  rows: 3\n  cols: 3\n"
    "  data: [262.5, 0, 159.5, 0, 262.5, 119.5, 0, 0, 1]\n",
    "intrinsics.json": json.dumps({"fx": 262.5, "fy": 262.5, "ppx": 159.5, "ppy": 119.5, "width": 320, "height": 240}),
    "dataset.toml": "intrinsics = [262.5, 262.5, 159.5, 119.5]\ndepth_scale = 1\nup = [0, -1, 0]\n",
}


@pytest.mark.parametrize("name", CAMERAS)
def test_cameras(name, tmp_path):
    folder = tmp_path / "frames"
    write_frames(folder)
    expected = check(folder)
    (folder / "intrinsics.txt").unlink()
    assert "intrinsics" in check(folder, 1)
    (folder / name).write_text(CAMERAS[name])
    assert check(folder) == expected
