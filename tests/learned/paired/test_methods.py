"""The methods of the tables: a depth image goes in, a surface of unit area comes out."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from safetensors.torch import load, save
from scipy.spatial.transform import Rotation

from benchmark.api.contracts import CanonicalForm, Shape, UnsupportedShape
from benchmark.api.learning import WEIGHTS
from benchmark.geometry.cleaning import connected_components, fans_per_vertex
from benchmark.geometry.depth import back_project
from benchmark.geometry.mesh import edges_of
from learned.images import surface_behind
from learned.paired.methods import Learned
from learned.paired.model import canonical_depth
from tests.learned.paired.test_model import replace_weights
from tests.learned.toy import TINY, Image, ellipsoid


def shape(depth: Image | None, seen: Image | None = None) -> Shape:
    """The view of an ellipsoid with a depth image, which need not be of the same."""
    surface, _ = back_project(ellipsoid() if seen is None else seen, 1.0)
    return Shape(identifier="x", mesh=surface, depth=depth)


@pytest.fixture
def method(trained: Path, tiny: None) -> Learned:
    """The method with the tiny model."""
    return Learned(configuration=TINY.name).load(trained)


def equal(first: CanonicalForm, second: CanonicalForm) -> bool:
    return np.array_equal(first.vertices, second.vertices) and np.array_equal(first.faces, second.faces)


def test_the_form_is_one_open_surface_of_unit_area(method: Learned) -> None:
    form = method.canonicalise(shape(ellipsoid(0.6, 0.6, x=0.15)))
    mesh = form.mesh
    assert mesh.area == pytest.approx(1)
    assert connected_components(mesh).max() == 0
    assert set(np.unique(edges_of(mesh.faces).counts)) == {1, 2}
    assert fans_per_vertex(mesh).max() == 1
    assert 500 < mesh.n_vertices < 4000
    assert set(form.notes) == {"predicted_foreground", "predicted_pieces", "predicted_bridges"}


def test_the_form_is_the_surface_behind_the_predicted_image(method: Learned, trained: Path) -> None:
    image = ellipsoid(0.3, 0.7)
    predicted = canonical_depth(trained, image)
    assert predicted.shape == image.shape
    both, either = (predicted > 0) & (image > 0), (predicted > 0) | (image > 0)
    assert both.sum() > 0.8 * either.sum()
    surface, _ = back_project(predicted, 1.0, jump=np.inf)
    form = method.canonicalise(shape(image))
    np.testing.assert_allclose(form.vertices, surface.vertices / surface.area**0.5)
    np.testing.assert_array_equal(form.faces, surface.faces)


def noisy_disc() -> Image:
    """A disc of one depth with a grain of a tenth of the half width to either side, twice what cuts the view input."""
    grain = np.random.default_rng(0).uniform(-0.05, 0.05, (500, 500))
    return np.where(ellipsoid() > 0, 0.5 + grain, 0).astype(np.float32)


def test_noise_does_not_tear_a_predicted_surface() -> None:
    whole, notes = surface_behind(noisy_disc())
    assert (notes["predicted_pieces"], notes["predicted_bridges"]) == (1, 0)
    # Nothing is missing beside the disc without the grain, whose only boundary is its outline.
    flat, _ = surface_behind(np.where(ellipsoid() > 0, np.float32(0.5), np.float32(0)))
    assert (whole.n_vertices, whole.n_faces) == (flat.n_vertices, flat.n_faces)
    assert np.count_nonzero(edges_of(whole.faces).counts == 1) == np.count_nonzero(edges_of(flat.faces).counts == 1)


def test_only_the_image_is_read(method: Learned) -> None:
    seen = shape(ellipsoid())
    rotation = Rotation.from_rotvec([0.3, -1.2, 0.7]).as_matrix()
    moved = seen.mesh.with_vertices(seen.mesh.vertices @ rotation.T + [3, 1, -2])
    other = Shape(identifier="y", mesh=moved, depth=seen.depth, seed=5)
    assert equal(method.canonicalise(seen), method.canonicalise(other))
    assert not equal(method.canonicalise(seen), method.canonicalise(shape(ellipsoid(0.3, 0.7), ellipsoid())))


def test_without_a_depth_image(method: Learned) -> None:
    with pytest.raises(UnsupportedShape, match="needs a depth image; use the view input"):
        method.canonicalise(shape(None))


def test_an_empty_depth_image(method: Learned) -> None:
    with pytest.raises(UnsupportedShape, match="the depth image is empty"):
        method.canonicalise(shape(np.zeros((500, 500), dtype=np.float32)))


@pytest.mark.usefixtures("tiny")
def test_a_network_that_predicts_nothing(trained: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(trained, tmp_path / "model"))
    weights = load((folder / WEIGHTS).read_bytes())
    weights["reconstruction.head.weight"][1] = 0
    weights["reconstruction.head.bias"][1] = -1
    replace_weights(folder, save(weights))
    with pytest.raises(UnsupportedShape, match="predicts an empty mask; train it for longer"):
        Learned(configuration=TINY.name).load(folder).canonicalise(shape(ellipsoid()))
