import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from baselines.feature_preserved import FeaturePreserved
from benchmark.geometry.mesh import Mesh
from benchmark.geometry.preparation import prepare
from tests.baselines.deformable import moved_to, shape_of, tube
from tests.baselines.test_constrained_mds import lopsided


def test_a_rigid_motion_of_the_surface_is_found_even_from_its_mirror_image():
    mesh = lopsided(tube(1.3))
    for image in (mesh.vertices, mesh.vertices * [1.0, -1.0, 1.0]):
        targets = image @ Rotation.from_euler("xyz", [1.0, 2.0, 3.0]).as_matrix().T
        form = FeaturePreserved().move_onto(shape_of(mesh), targets)
        np.testing.assert_allclose(moved_to(form.vertices, mesh.vertices), mesh.vertices, atol=1e-6)
        assert form.notes["largest_edge_strain"] < 1e-6
        assert form.notes["mirrored"] == ("no" if image is mesh.vertices else "yes")


def test_a_part_of_one_vertex_keeps_it():
    """A sphere with spikes, of which single vertices are parts."""
    sphere, generator = trimesh.creation.icosphere(subdivisions=2), np.random.default_rng(0)
    points = np.array(sphere.vertices)
    spikes = generator.choice(len(points), generator.integers(3, 12), replace=False)
    points[spikes] *= generator.uniform(1.5, 6, (len(spikes), 1))
    points = points * generator.uniform(0.3, 2, 3) + 0.1 * generator.standard_normal(points.shape) * generator.random()
    form = FeaturePreserved().canonicalise(shape_of(prepare(Mesh(points, sphere.faces)).mesh))
    assert np.isfinite(form.vertices).all()
