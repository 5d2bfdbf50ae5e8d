from benchmark.datasets.base import canonical_shapes
from benchmark.datasets.catalogue import open_dataset
from benchmark.geometry.camera import FRONT, SIDE
from tests.toy import rod, write_off


def test_tosca_takes_the_null_pose_else_the_first_and_sees_animals_from_their_side(tmp_path):
    for name in ("cat1", "nonrigid/cats/cat0", "gorilla0", "nonrigid/gorilla1", "wolf2", "wolf1"):
        write_off(tmp_path / "tosca" / f"{name}.off", rod(0.1, 1.0))
    dataset = open_dataset("tosca", tmp_path)
    chosen = canonical_shapes(dataset)
    assert [chosen[subject].identifier for subject in ("cat", "gorilla", "wolf")] == [
        "cat0",
        "gorilla1",
        "wolf1",
    ]
    assert {e.subject: dataset.camera(e) for e in dataset.shapes} == {
        "cat": SIDE,
        "gorilla": FRONT,
        "wolf": SIDE,
    }
