"""Registry of methods: built in, in installed packages, and in plugin files.

Each name maps to a string ``"module:attribute"``. The module is imported only when the method is needed, so a broken or
heavy method does not affect the others.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NoReturn

from benchmark.errors import ConfigurationError
from benchmark.plugins.inspection import S, installed, plugins_of
from benchmark.plugins.modules import unknown
from benchmark.plugins.parameters import combinations, split_name
from benchmark.plugins.specs import MethodSpec

__all__ = ["BUILT_IN", "EVERY", "MethodSpec", "methods", "plugin_methods", "select", "variant", "variants"]

#: Name that selects all methods, in addition to other names.
EVERY = "all"

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
    "learned-wide-extra": "learned.methods:WideExtra",
    "learned-streamed": "learned.methods:Streamed",
    "deformation-field": "learned.methods:DeformationField",
    "identity": "baselines.identity:Identity",
    "surface-area": "baselines.surface_area:SurfaceArea",
    "shape-dna": "baselines.shape_dna:ShapeDNA",
    "sd-gdm": "baselines.sd_gdm:SDGDM",
    "si-hks": "baselines.si_hks:ScaleInvariantHKS",
}


class KnownPlugins(dict[str, S]):
    """Plugins of one kind by name, in the order of the tables; an unknown name raises an error with the reason.

    Parameters
    ----------
    kind
        Methods or scorers.
    built_in
        Targets of the suite's plugins, by name.
    plugins
        Python files that may define more.

    Raises
    ------
    ConfigurationError
        If two have the same name, or a plugin file cannot be used.
    """

    def __init__(self, kind: type[S], built_in: Mapping[str, str], plugins: Iterable[Path]) -> None:
        super().__init__({name: kind(name, target) for name, target in built_in.items()})
        #: A line for each installed package with unusable plugins, which are omitted.
        found, self._faults, self.news = installed(kind, frozenset(built_in))  # type: ignore[arg-type]
        self._kind = kind.kind
        self.update({spec.name: spec for spec in found})
        for spec in (spec for path in plugins for spec in plugins_of(kind, path)):
            if spec.name in self:
                raise ConfigurationError(
                    f"two {kind.kind}s are called '{spec.name}': {self[spec.name].target} and {spec.target}",
                    "rename one",
                )
            self[spec.name] = spec

    def __missing__(self, name: str) -> NoReturn:
        raise self._faults.get(name) or unknown(self._kind, name, self)


def methods(plugins: Iterable[Path] = ()) -> KnownPlugins[MethodSpec]:
    """Return all known methods by name, in the order of the tables.

    Parameters
    ----------
    plugins
        Python files that define methods.

    Raises
    ------
    ConfigurationError
        If two methods have the same name, or a plugin file cannot be used.
    """
    return KnownPlugins(MethodSpec, BUILT_IN, plugins)


def plugin_methods(path: Path) -> list[MethodSpec]:
    """Return the methods in a plugin file; see :func:`benchmark.plugins.inspection.plugins_in`."""
    return plugins_of(MethodSpec, path)


def select(names: Iterable[str], known: Mapping[str, MethodSpec], plugins: Iterable[Path] = ()) -> list[MethodSpec]:
    """Return the named methods in table order; all if no name is given.

    If no method of a plugin file is named, all its methods are added, since passing the file implies interest in them.

    Parameters
    ----------
    names
        Names, optionally with parameters: ``"least-squares-mds[start=classic]"``, or with several values:
        ``"skeleton[bands=30|60]"``. ``"all"`` stands for the default selection, to which other names
        are added.
    known
        Result of :func:`methods`.
    plugins
        Plugin files passed by the user.

    Raises
    ------
    ConfigurationError
        If a name or a parameter is unknown, or a value is invalid.
    """
    patterns = [name.strip() for name in names]
    every = not patterns or EVERY in patterns
    specs = [spec for name in patterns if name != EVERY for spec in variants(name, known)]
    requested = {spec.name: spec for spec in specs}.values()
    named_modules = {spec.module for spec in requested}
    files = {str(path.resolve()) for path in plugins}
    chosen = []
    for spec in known.values():
        of_method = [variant for variant in requested if variant.base_name == spec.base_name]
        is_added = spec.module in files and spec.module not in named_modules
        if (every and all(variant.parameters for variant in of_method)) or is_added:
            chosen.append(dataclasses.replace(spec, named=spec.module in files))
        # A method added to all methods appears in the tables of its kind; one selected alone, in every table.
        chosen += [dataclasses.replace(variant, named=EVERY not in patterns) for variant in of_method]
    return chosen


def variants(name: str, known: Mapping[str, S]) -> list[S]:
    """Return the methods, or scorers, for a name with parameters, one for each combination of their values.

    See :func:`benchmark.plugins.parameters.combinations` for the syntax. Combinations that give the same method count
    once.

    Raises
    ------
    ConfigurationError
        If the name or a parameter is unknown, or a value is invalid.
    """
    base, inside = split_name(name) or (name, "")
    specs = (_with(known[base], given) for given in combinations(inside))
    return list({spec.name: spec for spec in specs}.values())


def variant(name: str, known: Mapping[str, S]) -> S:
    """Return the only method, or scorer, for a name with parameters in brackets.

    Raises
    ------
    ConfigurationError
        If the name or a parameter is unknown, a value is invalid, or the name stands for several methods.
    """
    specs = variants(name, known)
    if len(specs) > 1:
        raise ConfigurationError(f"'{name}' stands for {len(specs)} {specs[0].kind}s", f"name one: {specs[0].name}")
    return specs[0]


def _with(spec: S, given: Mapping[str, str]) -> S:
    if not given:
        return spec
    changed = spec.with_parameters(given)
    if not changed.missing_packages():
        changed.create()  # lets the class refuse invalid combinations now
    return changed
