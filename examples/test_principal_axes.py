"""What Principal Axes promises."""

from __future__ import annotations

import shutil

import numpy as np
import pytest
from principal_axes import PrincipalAxes
from scipy.spatial.distance import pdist

from benchmark.api import Shape
from benchmark.check.shapes import figure


@pytest.mark.skipif(shutil.which("octave-cli") is None, reason="there is no Octave")
def test_a_form_has_its_principal_axes_along_the_coordinates_and_is_the_shape() -> None:
    mesh = figure()
    form = PrincipalAxes().canonicalise(Shape(identifier="figure", mesh=mesh))
    spread = np.cov(form.vertices.T)
    np.testing.assert_allclose(spread, np.diag(np.diag(spread)), atol=1e-12)
    np.testing.assert_allclose(pdist(form.vertices), pdist(mesh.vertices), atol=1e-12)
