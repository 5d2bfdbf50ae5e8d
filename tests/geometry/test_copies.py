"""A mesh that holds its surface twice is refused; pieces that lie beside each other are not."""

from pathlib import Path

import numpy as np
import pytest

from benchmark.datasets.folder import folder_set
from benchmark.datasets.mesh_files import read_mesh, read_surface, write_mesh
from benchmark.errors import InvalidMesh
from benchmark.geometry.copies import check_copies
from benchmark.geometry.mesh import Mesh
from tests.toy import rod, write_off
from tests.verbs import call, refusal

INPUTS = Path(__file__).parent / "inputs" / "copies"
AREA = 5.28932
SAID = (
    "two of its 2 pieces run along each other over .* of their area: a copy.*; "
    "export the surface once"
)


def together(*meshes):
    """One mesh of several, which share no vertex."""
    starts = np.cumsum([0, *(mesh.n_vertices for mesh in meshes)])
    faces = [mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)]
    return Mesh(np.concatenate([mesh.vertices for mesh in meshes]), np.concatenate(faces))


def moved(mesh, offset=(0.0, 0.0, 0.0), scale=1.0):
    return Mesh(mesh.vertices * scale + np.array(offset), mesh.faces)


def opened(mesh, share):
    """The first faces of a mesh."""
    return Mesh(mesh.vertices, mesh.faces[: int(share * mesh.n_faces)])


def halves(mesh):
    """The faces on either side of a plane, which meet along it."""
    is_left = mesh.vertices[mesh.faces, 0].mean(axis=1) < mesh.vertices[:, 0].mean()
    return [Mesh(mesh.vertices, mesh.faces[side]) for side in (is_left, ~is_left)]


ROD = rod(0.1, 1.0)
FINE = rod(0.1, 1.0, rings=40, sides=30)

COPIES = {
    "a collider around it": together(ROD, moved(ROD, scale=1.02)),
    "a rounded copy": together(ROD, moved(ROD, (1e-4, 0, 0))),
    "another level of detail": together(ROD, FINE),
    "the other way round": together(ROD, Mesh(ROD.vertices * 1.005, ROD.faces[:, ::-1])),
    "a variant with a hole": together(ROD, opened(moved(ROD, (0.002, 0, 0)), 0.9)),
    "three levels": together(ROD, moved(ROD, scale=1.01), moved(ROD, scale=0.99)),
    "a copy beside other pieces": together(ROD, moved(ROD, (3, 0, 0)), moved(ROD, scale=1.01)),
    "a small one far away": moved(together(ROD, moved(ROD, scale=1.01)), (50, 0, 0), 1e-3),
}

NO_COPIES = {
    "one piece": ROD,
    "side by side": together(ROD, moved(ROD, (0.21, 0, 0))),
    "touching": together(ROD, moved(ROD, (0.2, 0, 0))),
    "one within the other": together(ROD, moved(ROD, scale=0.5)),
    "a patch": together(ROD, opened(moved(ROD, scale=1.01), 0.3)),
    "halves": together(*halves(ROD)),
    "a button": together(ROD, moved(ROD, (0.1, 0, 0), 0.05)),
}


@pytest.mark.parametrize("mesh", COPIES.values(), ids=COPIES)
def test_pieces_that_run_along_each_other_are_refused(mesh):
    with pytest.raises(InvalidMesh, match="run along each other"):
        check_copies(mesh)


@pytest.mark.parametrize("mesh", NO_COPIES.values(), ids=NO_COPIES)
def test_other_pieces_are_not_refused(mesh):
    check_copies(mesh)


def test_a_coarser_copy_that_keeps_positions_is_found():
    coarse = Mesh(ROD.vertices, ROD.faces[1:])  # shares all positions
    corners = np.array([ROD.vertices[0], *ROD.vertices[5:7]])
    check_copies(ROD)
    with pytest.raises(InvalidMesh, match="run along each other"):
        check_copies(together(ROD, coarse, Mesh(corners, np.array([[0, 1, 2]]))))


@pytest.mark.parametrize("name", ["collider.gltf", "lod-names.gltf"])
def test_a_copy_is_named_by_every_verb(name, tmp_path):
    with pytest.raises(InvalidMesh, match=f"{name}: {SAID}"):
        read_surface(INPUTS / name)
    for number in range(2):
        for kind, size in (("thin", 0.5), ("thick", 1.0)):
            write_off(tmp_path / f"{kind}{number}.off", rod(0.1, size + number / 10))
    copied = tmp_path / f"thick2{Path(name).suffix}"
    copied.write_bytes((INPUTS / name).read_bytes())
    checked = call("data", "check", tmp_path, code=1)
    assert "error    thick2.gltf  two of its 2 pieces run along each other" in checked
    form = tmp_path / "form.off"
    assert "run along each other" in refusal("canonicalise", "-m", "gps", copied, "-o", form)
    entries = folder_set(tmp_path).shapes
    with pytest.raises(InvalidMesh, match="run along each other"):
        folder_set(tmp_path).load(next(one for one in entries if one.identifier == "thick2"))


def test_nodes_that_are_levels_of_detail_of_others_are_no_roots():
    plain = read_mesh(INPUTS / "plain.gltf")
    level = read_surface(INPUTS / "lod-msft-noscene.gltf")
    assert plain.area == pytest.approx(AREA, rel=1e-5)
    assert level.area == pytest.approx(plain.area, rel=1e-12)


def test_forms_of_other_programs_may_lie_on_themselves(tmp_path):
    write_mesh(tmp_path / "form.off", COPIES["a rounded copy"])
    assert read_mesh(tmp_path / "form.off").n_faces == 2 * ROD.n_faces
