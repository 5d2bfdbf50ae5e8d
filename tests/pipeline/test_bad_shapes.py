"""One bad shape costs one shape: the others are prepared as if it were not there, and the record names it."""

import numpy as np
import pytest

from benchmark.datasets.folder import folder_set
from benchmark.errors import UnsupportedShape
from benchmark.geometry.mesh import Mesh
from benchmark.pipeline.method_run import Preparation, require_arrays
from benchmark.pipeline.storage.store import Store
from tests.geometry.mutations import valid_files
from tests.toy import rod, write_off, write_rods
from tests.verbs import call

GOOD = rod(0.1, 0.7)


def moved(factor=1.0, spike=1.0):
    vertices = factor * GOOD.vertices
    vertices[7] *= spike
    return Mesh(vertices, GOOD.faces)


def crumbs(count=5000):
    """Equal tetrahedra, each a component."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]) * 0.004
    sides = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
    places = np.stack(np.meshgrid(*[np.arange(18) * 0.02] * 3), axis=-1).reshape(-1, 3)[:count]
    return Mesh(
        (places[:, None] + corners).reshape(-1, 3), (4 * np.arange(count)[:, None, None] + sides).reshape(-1, 3)
    )


#: Bad shapes, with the reasons under the mesh and the view input; "" where the shape can be processed.
BAD = {
    "points": (moved(0.0), "has extent 0", "has extent 0"),
    "line": (Mesh(GOOD.vertices * [1, 0, 0], GOOD.faces), "0 triangles with area", "none of the 576 triangles"),
    "tiny": (moved(1e-160), "has extent", "has extent"),
    "huge": (moved(1e160), "has extent", "has extent"),
    "large": (moved(1e5), "", "of the camera's frame; check its unit"),
    "small": (moved(1e-5), "", "pixels of the shape, fewer than 200"),
    "spike": (moved(1.0, 1e5), "", "of the camera's frame; check its unit"),
    "crumbs": (crumbs(), "", "hold no piece of 8 samples"),
}


@pytest.mark.parametrize("name", BAD)
@pytest.mark.parametrize("input_", ["mesh", "view"])
def test_the_others_are_prepared_as_if_a_bad_shape_were_not_there(tmp_path, name, input_):
    folder = write_rods(tmp_path / "rods", bends=(0.0, 1.2))
    alone = Preparation(folder_set(folder), input_)
    expected = {entry.identifier: require_arrays(alone.artefact(entry)) for entry in alone.dataset.shapes}
    write_off(folder / "thin9.off", BAD[name][0])
    beside = Preparation(folder_set(folder), input_)
    for entry in beside.dataset.shapes:
        if entry.identifier in expected:
            found = require_arrays(beside.artefact(entry))
            assert all(found[key].tobytes() == array.tobytes() for key, array in expected[entry.identifier].items())
            continue
        if reason := BAD[name][1 if input_ == "mesh" else 2]:
            with pytest.raises(UnsupportedShape, match=reason):
                require_arrays(beside.artefact(entry))
        else:
            assert require_arrays(beside.artefact(entry))["vertices"].shape >= GOOD.vertices.shape


def test_a_set_with_bad_shapes_is_scored_without_them_and_the_table_names_them(tmp_path):
    folder = write_rods(tmp_path / "rods", bends=(0.0, 1.2))
    for number, name in enumerate(BAD):
        write_off(folder / f"{'thin' if number % 2 else 'thick'}{10 + number}.off", BAD[name][0])
    content = bytearray(valid_files(GOOD)["packed.mat"])
    content[300] ^= 255
    (folder / "thin9.mat").write_bytes(content)
    assert "thin9.mat  not a readable mat file" in call("data", "check", folder, code=1)
    call("run", "-d", folder, "-m", "identity", "-j", "0", "--results", tmp_path)
    records = {found["input"]: found for found in Store.open(tmp_path).records}
    for at, input_ in enumerate(("mesh", "view"), start=1):
        refused = dict(records[input_]["unsupported"])
        wrong = {f"{'thin' if n % 2 else 'thick'}{10 + n}": BAD[name][at] for n, name in enumerate(BAD)}
        assert refused.keys() == {"thin9", *(identifier for identifier, reason in wrong.items() if reason)}
        assert all(reason in refused[identifier] for identifier, reason in wrong.items() if reason)
        assert "thin9.mat: not a readable mat file" in refused["thin9"]
        assert records[input_]["notes"]["lost_area"]["max"] < 0.25
