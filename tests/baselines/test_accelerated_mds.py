import numpy as np
import pytest

from baselines.accelerated_mds import AcceleratedMDS
from baselines.classic_mds import ClassicMDS
from benchmark.api.contracts import Shape
from benchmark.datasets.official.tosca import tosca
from benchmark.errors import ConfigurationError
from benchmark.geometry.preparation import prepare
from tests.baselines.embedding import brute_force_stress, limbed


def test_all_vertices_as_samples_give_classic_scaling():
    shape = limbed(120)
    classic = ClassicMDS().canonicalise(shape).vertices
    for variant in ("interpolated", "samples"):
        form = AcceleratedMDS(variant=variant, samples=120).canonicalise(shape).vertices
        np.testing.assert_allclose(form, classic, atol=1e-5)


@pytest.mark.data
@pytest.mark.parametrize("identifier", ["michael3"])
def test_the_stress_of_animals_and_people_is_within_five_per_cent_of_classic_scaling(data_root, identifier):
    dataset = tosca(data_root)
    entry = next(entry for entry in dataset.entries if entry.identifier == identifier)
    shape = Shape(identifier=identifier, mesh=prepare(dataset.load(entry)).mesh)
    form = AcceleratedMDS(variant="interpolated").canonicalise(shape)
    assert (
        brute_force_stress(form.vertices, shape.geodesics()) < 1.05 * ClassicMDS().canonicalise(shape).notes["stress"]
    )


def test_an_unknown_variant_is_refused():
    with pytest.raises(ConfigurationError, match="did you mean samples"):
        AcceleratedMDS(variant="sample")  # type: ignore[arg-type]
