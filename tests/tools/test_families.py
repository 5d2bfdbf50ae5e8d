import numpy as np

from benchmark.geometry.camera import Camera
from benchmark.plugins.registry import BUILT_IN, methods, variant
from benchmark.protocols.tables import ONLY_NAMED, VARIANTS
from tests.toy import rod
from tools.families import FAMILIES, family_figure


def test_each_pose_is_drawn_beside_what_each_method_makes_of_it():
    poses = [rod(0.1, bend) for bend in (0.0, 1.5)]
    figure = family_figure(["pca", "least-squares-mds[metric=biharmonic]"], poses, Camera((0.0, 1.0, 0.0)), size=40)
    titles = [axes.get_title() for axes in figure.axes]
    assert titles[:3] == ["input", "PCA", "Least Square MDS\n(metric=biharmonic)"]
    pictures = [np.asarray(axes.images[0].get_array()) for axes in figure.axes]
    assert len(pictures) == 6
    assert all(np.ptp(picture) > 0.2 for picture in pictures)
    straight, bent = pictures[0], pictures[3]
    assert np.abs(straight - bent).max() > 0.3


def test_every_form_belongs_to_one_family():
    known = methods()
    shown = [variant(name, known) for names in FAMILIES.values() for name in names]
    forms = {name for name in BUILT_IN if known[name].info.family != "control" and not known[name].learns} - ONLY_NAMED
    assert {spec.base_name for spec in shown} == forms
    further = {known[name].with_parameters(each).name for name, variants in VARIANTS.items() for each in variants}
    assert further <= {spec.name for spec in shown}
    assert len({spec.name for spec in shown}) == len(shown)
