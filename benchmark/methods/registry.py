"""Names of methods: built-in ones, those of installed packages, and those of a plugin file.

A name stands for the string ``"module:attribute"``; the module is imported only when the method is looked at, so that
one broken or heavy method costs nobody else anything.
"""

from __future__ import annotations

import dataclasses
import importlib
import importlib.metadata
import importlib.util
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from benchmark.contracts import Descriptor, Method, MethodInfo
from benchmark.errors import BenchmarkError, ConfigurationError, did_you_mean, one_line
from benchmark.methods.information import problems_of
from benchmark.methods.plugins import import_plugin
from benchmark.parameters.values import assignments, departures, parameter_values, spelt

ENTRY_POINTS = "canonical_forms.methods"

#: Stands for all methods where others are named beside it.
EVERY = "all"

BUILT_IN: dict[str, str] = {
    "classic-mds": "baselines.classic_mds:ClassicMDS",
    "fast-mds": "baselines.fast_mds:FastMDS",
    "non-metric-mds": "baselines.non_metric_mds:NonMetricMDS",
    "least-squares-mds": "baselines.least_squares_mds:LeastSquaresMDS",
    "constrained-mds": "baselines.constrained_mds:ConstrainedMDS",
    "gps": "baselines.gps:GPS",
    "mesh-unfolding": "baselines.mesh_unfolding:MeshUnfolding",
    "skeleton": "baselines.skeleton:Skeleton",
    "learned": "learned.methods:Learned",
    "accelerated-mds": "baselines.accelerated_mds:AcceleratedMDS",
    "spectral-mds": "baselines.spectral_mds:SpectralMDS",
    "nystrom-mds": "baselines.nystrom_mds:NystromMDS",
    "subspace-mds": "baselines.subspace_mds:SubspaceMDS",
    "feature-preserved": "baselines.feature_preserved:FeaturePreserved",
    "euclidean-distance": "baselines.euclidean_distance:EuclideanDistance",
    "learned-without-srf": "learned.methods:WithoutSRF",
    "learned-without-lrf": "learned.methods:WithoutLRF",
    "learned-strict": "learned.methods:Strict",
    "learned-wide": "learned.methods:Wide",
    "learned-wide-extra": "learned.methods:WideExtra",
    "identity": "baselines.identity:Identity",
    "pca": "baselines.pca:PCA",
    "random": "baselines.random_form:RandomForm",
    "surface-area": "baselines.surface_area:SurfaceArea",
    "shape-dna": "baselines.shape_dna:ShapeDNA",
    "sd-gdm": "baselines.sd_gdm:SDGDM",
    "wks-mean": "baselines.wks_mean:MeanWKS",
}


@dataclass(frozen=True)
class MethodSpec:
    """A method by name, with everything needed to make it again in another process.

    Parameters
    ----------
    base_name
        Name without parameters.
    target
        ``"module:attribute"``, or ``"/path/to/file.py:attribute"`` for a plugin file.
    parameters
        Parameters as text or as they are; those that differ from their defaults are kept, normalised and in the order
        of the fields, so that two ways to write one method make equal objects.
    named
        Whether somebody asked for this method, by its name or by passing its file.

    Raises
    ------
    ConfigurationError
        If there is no such parameter, or a value does not fit.
    """

    base_name: str
    target: str
    parameters: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    named: bool = False

    def __post_init__(self) -> None:
        if self.parameters:
            object.__setattr__(self, "parameters", departures(self.load(), self.parameters, self.base_name))

    @property
    def name(self) -> str:
        """Name on the command line, in its one spelling."""
        return f"{self.base_name}[{self._chosen(',')}]" if self.parameters else self.base_name

    def _chosen(self, separator: str) -> str:
        return separator.join(f"{key}={spelt(value)}" for key, value in self.parameters.items())

    @property
    def module(self) -> str:
        """Module name or plugin path."""
        return self.target.rpartition(":")[0]

    def load(self) -> type[Any]:
        """Import and return the class.

        Raises
        ------
        ConfigurationError
            If it cannot be imported or is not a method.
        """
        attribute = self.target.rpartition(":")[2]
        try:
            found = getattr(
                import_plugin(self.module) if self.module.endswith(".py") else importlib.import_module(self.module),
                attribute,
            )
        except ImportError as error:
            raise ConfigurationError(
                f"method '{self.base_name}' cannot be imported: {error}", f"install what {self.module} needs"
            ) from error
        except AttributeError as error:
            raise ConfigurationError(f"{self.module} has no '{attribute}'", "correct the entry point") from error
        if not isinstance(getattr(found, "info", None), MethodInfo):
            raise ConfigurationError(
                f"{self.target} has no 'info: ClassVar[MethodInfo]'", "see 'Add a method' in the README"
            )
        return cast(type[Any], found)

    def create(self) -> Method | Descriptor:
        """Make the method with its parameters.

        Raises
        ------
        ConfigurationError
            If the class refuses them, or what it makes is no method.
        """
        found = self.load()
        try:
            created = found(**self.parameters)
        except BenchmarkError:
            raise
        except (Exception, SystemExit) as error:
            raise ConfigurationError(
                f"{self.name} cannot be made: {one_line(error)}",
                "choose other parameters" if self.parameters else "give every parameter a default that fits",
            ) from error
        if not isinstance(created, (Method, Descriptor)):
            raise ConfigurationError(
                f"{self.target} has neither 'canonicalise' nor 'describe' and 'distances'",
                "see 'Add a method' in the README",
            )
        return created

    @property
    def info(self) -> MethodInfo:
        """What the method says about itself."""
        return cast(MethodInfo, self.load().info)

    @property
    def title(self) -> str:
        """Name in the tables, with the parameters that differ from their defaults."""
        return f"{self.info.title} ({self._chosen(', ')})" if self.parameters else self.info.title

    def resolved_parameters(self) -> dict[str, Any]:
        """All parameters, defaults included, normalised."""
        return parameter_values(self.create())

    @property
    def learns(self) -> bool:
        """Whether the method is a learner; see :class:`benchmark.learning.Learner`."""
        found = self.load()
        return all(hasattr(found, name) for name in ("train", "load", "model_name", "split"))

    def with_parameters(self, parameters: Mapping[str, Any]) -> MethodSpec:
        """Return the method with further parameters, as text or as they are."""
        return dataclasses.replace(self, parameters={**self.parameters, **parameters})

    def with_parameter(self, name: str, value: Any) -> MethodSpec:
        """Return the method with one more parameter."""
        return self.with_parameters({name: value})

    def without_parameter(self, name: str) -> MethodSpec:
        """Return the method with the default of one parameter."""
        others = {key: value for key, value in self.parameters.items() if key != name}
        return dataclasses.replace(self, parameters=others)

    def missing_packages(self) -> tuple[str, ...]:
        """Packages that the method declares and that are not installed."""
        return tuple(name for name in self.info.requires if importlib.util.find_spec(name) is None)


def methods(plugins: Iterable[Path] = ()) -> dict[str, MethodSpec]:
    """All known methods by name, in the order of the tables.

    Parameters
    ----------
    plugins
        Python files that define methods.

    Raises
    ------
    ConfigurationError
        If two methods have one name, or a plugin file cannot be used.
    """
    found = {name: MethodSpec(name, target) for name, target in BUILT_IN.items()}
    for point in importlib.metadata.entry_points(group=ENTRY_POINTS):
        _add(found, MethodSpec(point.name, point.value))
    for path in plugins:
        for spec in plugin_methods(path):
            _add(found, spec)
    return found


def select(names: Iterable[str], known: Mapping[str, MethodSpec], plugins: Iterable[Path] = ()) -> list[MethodSpec]:
    """Return the named methods in table order; all when no name is given.

    Methods of a plugin file are always in: whoever passes the file wants to see them beside the named ones.

    Parameters
    ----------
    names
        Names, each with parameters if need be: ``"least-squares-mds[start=classic]"``; ``"all"`` stands for what is
        chosen when none is given, to add further ones to it.
    known
        What :func:`methods` found.
    plugins
        The plugin files that were passed.

    Raises
    ------
    ConfigurationError
        If a name or a parameter is unknown, or a value does not fit.
    """
    asked = [name.strip() for name in names]
    every = not asked or EVERY in asked
    specs = [variant(name, known) for name in asked if name != EVERY]
    wanted = {spec.name: spec for spec in specs}.values()
    files = {str(path.resolve()) for path in plugins}
    chosen = []
    for spec in known.values():
        variants = [variant for variant in wanted if variant.base_name == spec.base_name]
        if (every and all(variant.parameters for variant in variants)) or (spec.module in files and not variants):
            chosen.append(dataclasses.replace(spec, named=spec.module in files))
        # Beside all methods, a further one goes where its kind goes; alone, it goes wherever it is asked for.
        chosen += [dataclasses.replace(variant, named=EVERY not in asked) for variant in variants]
    return chosen


def variant(name: str, known: Mapping[str, MethodSpec]) -> MethodSpec:
    """Return the method that a name with parameters in brackets stands for.

    Raises
    ------
    ConfigurationError
        If the name or a parameter is unknown, or a value does not fit.
    """
    match = re.fullmatch(r"([^\[\]]+)(?:\[([^\[\]]*)\])?", name.strip())
    base = match[1].strip() if match else name
    if not match or base not in known:
        raise did_you_mean("method", base, known)
    given = assignments(match[2] or "")
    if not given:
        return known[base]
    spec = known[base].with_parameters(given)
    if not spec.missing_packages():
        spec.create()  # a class may refuse parameters by a rule of its own, and had better do so now
    return spec


def plugin_methods(path: Path) -> list[MethodSpec]:
    """Methods defined in a plugin file, in the order of the file.

    Raises
    ------
    ConfigurationError
        If the file cannot be imported, defines no method, or a method says of itself what cannot be.
    """
    module = import_plugin(str(path.resolve()))
    specs = []
    for attribute, value in vars(module).items():
        if isinstance(value, type) and value.__module__ == module.__name__:
            info = getattr(value, "info", None)
            if isinstance(info, MethodInfo):
                for problem, mend in problems_of(info):
                    raise ConfigurationError(f"plugin {path}, {attribute}: {problem}", mend)
                specs.append(MethodSpec(info.name, f"{path.resolve()}:{attribute}"))
    if not specs:
        raise ConfigurationError(
            f"plugin {path} defines no method", "give a class an 'info: ClassVar[MethodInfo]' or use @canonical_form"
        )
    return specs


def _add(found: dict[str, MethodSpec], spec: MethodSpec) -> None:
    if spec.name in found:
        raise ConfigurationError(
            f"two methods are called '{spec.name}': {found[spec.name].target} and {spec.target}", "rename one"
        )
    found[spec.name] = spec
