import numpy as np

from baselines.identity import Identity
from tests.baselines.embedding import limbed


def test_the_form_is_the_shape():
    shape = limbed(100)
    form = Identity().canonicalise(shape)
    np.testing.assert_array_equal(form.vertices, shape.mesh.vertices)
    np.testing.assert_array_equal(form.faces, shape.mesh.faces)
