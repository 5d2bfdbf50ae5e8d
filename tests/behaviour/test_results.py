"""Forms of depth images in Python."""

import numpy as np
import pytest

from benchmark.depth_forms import canonical_form_of_depth
from benchmark.errors import BenchmarkError


def test_the_form_of_a_depth_image(material):
    depth = np.load(material / "frames" / "lean0.npy")
    camera = (262.5, 262.5, 159.5, 119.5)
    matrix = np.array([[262.5, 0, 159.5], [0, 262.5, 119.5], [0, 0, 1]])
    form = canonical_form_of_depth(depth, camera, method="gps")
    assert form.vertices.shape == (1523, 3)
    assert form.faces.shape[1] == 3
    again = canonical_form_of_depth((1000 * depth).astype(np.uint16), matrix, depth < 2.5, "gps", seed=1)
    assert abs(len(again.vertices) - len(form.vertices)) < 50
    with pytest.raises(BenchmarkError):
        canonical_form_of_depth(np.zeros_like(depth), camera, method="gps")
