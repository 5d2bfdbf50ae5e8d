"""The methods of the tables: a depth image goes in, a surface of unit area comes out."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
import torch
from safetensors.torch import load, save
from scipy.spatial.transform import Rotation

from benchmark.api.contracts import CanonicalForm, Shape, UnsupportedShape
from benchmark.api.learning import WEIGHTS
from benchmark.errors import ConfigurationError
from benchmark.geometry.depth import back_project
from benchmark.registry import select_one
from learned.methods import Average, ConfigurationName, Flat, Learned, Streamed, WideExtra
from learned.models import CONFIGURATIONS, average_body
from tests.learned.toy import TINY, Image, ellipsoid, person, replace_weights


def shape(depth: Image | None, seen: Image | None = None) -> Shape:
    """The view of an ellipsoid with a depth image, which need not be of the same."""
    surface, _ = back_project(ellipsoid() if seen is None else seen, 1.0)
    return Shape(identifier="x", mesh=surface, depth=depth)


def equal(first: CanonicalForm, second: CanonicalForm) -> bool:
    return np.array_equal(first.vertices, second.vertices) and np.array_equal(
        first.faces, second.faces
    )


def test_only_the_image_is_read(method: Learned) -> None:
    seen = shape(ellipsoid())
    rotation = Rotation.from_rotvec([0.3, -1.2, 0.7]).as_matrix()
    moved = seen.mesh.with_vertices(seen.mesh.vertices @ rotation.T + [3, 1, -2])
    other = Shape(identifier="y", mesh=moved, depth=seen.depth, seed=5)
    assert equal(method.canonicalise(seen), method.canonicalise(other))
    assert not equal(
        method.canonicalise(seen), method.canonicalise(shape(ellipsoid(0.3, 0.7), ellipsoid()))
    )


@pytest.mark.parametrize(
    ("image", "message"),
    [
        (None, "needs a depth image; use the view input"),
        (np.zeros((500, 500), np.float32), "depth image is empty"),
    ],
)
def test_a_shape_without_an_image_is_refused(
    method: Learned, image: Image | None, message: str
) -> None:
    with pytest.raises(UnsupportedShape, match=message):
        method.canonicalise(shape(image))


def test_a_network_that_predicts_nothing(method: Learned, trained: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(trained, tmp_path / "model"))
    weights = load((folder / WEIGHTS).read_bytes())
    weights["reconstruction.head.weight"][1] = 0
    weights["reconstruction.head.bias"][1] = -1
    replace_weights(folder, save(weights))
    with pytest.raises(UnsupportedShape, match="predicts an empty mask; train it for longer"):
        method.load(folder).canonicalise(shape(ellipsoid()))


def test_a_model_of_another_network_is_refused(trained: Path) -> None:
    with pytest.raises(
        ConfigurationError, match=f"holds '{TINY.name}', not 'literal'; name the folder"
    ):
        Learned().load(trained)


def test_controls_have_the_predicted_mask_and_a_depth_that_no_image_moves(
    method: Learned, monkeypatch: pytest.MonkeyPatch
) -> None:
    for image in (person(), ellipsoid(0.3, 0.7)):
        depth, mask = Learned().predict(image)
        for control, expected in (
            (Average(), average_body(Learned().model_folder, 128)),
            (Flat(), torch.full((128, 128), 0.5)),
        ):
            found = control.predict(image)
            assert torch.equal(found[1], mask) and torch.equal(found[0], expected.double())
            assert not torch.equal(found[0], depth)
    monkeypatch.setattr(Learned, "relief", "average")
    with pytest.raises(
        ConfigurationError,
        match="no average body of 32 x 32 pixels; take a model of 128 x 128 pixels, of people-fold",
    ):
        method.predict(person())


def test_only_rows_of_controls_replace_the_predicted_depth() -> None:
    """Their keys hold the file of average bodies, which those of other networks lack."""
    with pytest.raises(ConfigurationError, match="relief"):
        select_one("learned[relief=average]")
    assert "average-bodies.safetensors" in " ".join(select_one("learned-average").files)


def test_the_rows_differ_in_what_their_names_say() -> None:
    assert {*get_args(ConfigurationName)} == {name for name in CONFIGURATIONS if name != TINY.name}
    assert WideExtra(training="animals-sampled").model_folder.parts[-2:] == (
        "animals-sampled",
        "wide-extra-seed0",
    )
    assert Streamed().model_folder.parts[-2:] == ("humans-varied", "streamed-people-seed0")
