"""Methods and scorers that are known by name.

Each name maps to a target ``"module:attribute"``. The module is imported only when it is needed, so
a heavy method does not delay the others.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import NoReturn

from benchmark.api.contracts import MethodInfo
from benchmark.api.datasets import ShapeSet
from benchmark.api.scoring import ScorerInfo
from benchmark.defaults import ALL_METHODS, DEFAULT_SCORER
from benchmark.errors import ConfigurationError, did_you_mean
from benchmark.registry.components import Component, Kind
from benchmark.registry.modules import load_module

BUILT_IN: dict[str, str] = {
    "classic-mds": "baselines.classic_mds:ClassicMDS",
    "fast-mds": "baselines.fast_mds:FastMDS",
    "non-metric-mds": "baselines.smacof:NonMetricMDS",
    "least-squares-mds": "baselines.smacof:LeastSquaresMDS",
    "constrained-mds": "baselines.constrained_mds:ConstrainedMDS",
    "gps": "baselines.gps:GPS",
    "mesh-unfolding": "baselines.mesh_unfolding:MeshUnfolding",
    "skeleton": "baselines.skeleton:Skeleton",
    "learned": "learned.methods:Learned",
    "accelerated-mds": "baselines.accelerated_mds:AcceleratedMDS",
    "fast-classical-scaling": "baselines.fast_classical_scaling:FastClassicalScaling",
    "feature-preserved": "baselines.feature_preserved:FeaturePreserved",
    "learned-without-srf": "learned.methods:WithoutSRF",
    "learned-without-lrf": "learned.methods:WithoutLRF",
    "learned-without-weighting": "learned.methods:WithoutWeighting",
    "learned-strict": "learned.methods:Strict",
    "learned-size-free": "learned.methods:SizeFree",
    "learned-average": "learned.methods:Average",
    "learned-flat": "learned.methods:Flat",
    "learned-wide-extra": "learned.methods:WideExtra",
    "learned-streamed": "learned.methods:Streamed",
    "deformation-field": "learned.methods:DeformationField",
    "identity": "baselines.identity:Identity",
    "surface-area": "baselines.surface_area:SurfaceArea",
    "shape-dna": "baselines.shape_dna:ShapeDNA",
    "sd-gdm": "baselines.sd_gdm:SDGDM",
    "si-hks": "baselines.si_hks:ScaleInvariantHKS",
}

SCORERS: dict[str, str] = {DEFAULT_SCORER: "retrieval.cmbof:CMBOF"}


class Known(dict[str, Component]):
    """Components of one kind by name, in the order of the tables.

    An unknown name raises an error with a hint.
    """

    def __init__(self, kind: Kind, components: Iterable[Component]) -> None:
        """Register components by name.

        Parameters
        ----------
        kind
            ``"method"`` or ``"scorer"``.
        components
            The components.

        Raises
        ------
        ConfigurationError
            If two have one name, or one has the name that stands for all.
        """
        super().__init__()
        self._kind = kind
        for component in components:
            name = component.name
            if name == ALL_METHODS:
                problem = f"a {kind} is called '{ALL_METHODS}', which stands for all"
                raise ConfigurationError(problem, "rename it")
            if name in self:
                both = f"{self[name].target} and {component.target}"
                problem = f"two {kind}s are called '{name}': {both}"
                raise ConfigurationError(problem, "rename one")
            self[name] = component

    def __missing__(self, name: str) -> NoReturn:
        error = did_you_mean(self._kind, name, self)
        file = Path(f"{name.replace('-', '_')}.py")
        hint = f"{error.hint} (for one of your own, pass --plugin FILE)"
        if file.is_file():
            hint = f"pass --plugin {file}"
        raise ConfigurationError(error.problem, hint)


def by_name(kind: Kind, plugins: Iterable[Path] = ()) -> Known:
    """Return all components of a kind by name: those of the suite and of plugin files.

    Raises
    ------
    ConfigurationError
        If two of them have the same name, or a plugin file cannot be imported or defines nothing.
    """
    targets = BUILT_IN if kind == "method" else SCORERS
    components = [Component(kind, name, target) for name, target in targets.items()]
    # A file may be named twice, as by a pattern and by its name.
    files = {path.resolve(): path for path in plugins}
    for path in files.values():
        components += [component for component in in_file(path) if component.kind == kind]
    return Known(kind, components)


def in_file(path: Path) -> list[Component]:
    """Return the methods and scorers that a plugin file defines, in the order of the file.

    These are the classes with an ``info`` that the file defines itself, not those that it imports.

    Raises
    ------
    ConfigurationError
        If the path is no Python file, or cannot be imported; if it defines no method and no scorer,
        or makes a data set.
    """
    if path.suffix != ".py" or not path.is_file():
        raise ConfigurationError(f"there is no Python file {path}", "name the .py file of a plugin")
    resolved = path.resolve()
    if resolved.suffix != ".py":
        problem = f"{path} is a link to {resolved}, which is no Python file"
        raise ConfigurationError(problem, "name the .py file of a plugin")

    target = str(resolved)
    module = load_module(target)
    classes: dict[type, str] = {}  # of two names of one class, the first in the file
    for attribute, value in vars(module).items():
        if isinstance(value, ShapeSet):
            problem = f"{path} makes a data set, which is a folder of meshes and no plugin"
            example = "examples/bent_ellipsoids.py does: python bent_ellipsoids.py DIR"
            raise ConfigurationError(problem, f"write a folder, as {example}")
        if isinstance(value, type) and value.__module__ == module.__name__:
            classes.setdefault(value, attribute)
    components = []
    for cls, attribute in classes.items():
        info = getattr(cls, "info", None)
        if isinstance(info, MethodInfo):
            components.append(Component("method", info.name, f"{target}:{attribute}"))
        elif isinstance(info, ScorerInfo):
            components.append(Component("scorer", info.name, f"{target}:{attribute}"))
    if not components:
        hint = "write a class with an 'info' (MethodInfo or ScorerInfo), or use @canonical_form"
        raise ConfigurationError(f"{path} defines no method and no scorer", hint)
    return components
