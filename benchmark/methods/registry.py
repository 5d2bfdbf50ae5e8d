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
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any, cast

from benchmark.contracts import Descriptor, Method, MethodInfo
from benchmark.errors import ConfigurationError, did_you_mean

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
    name
        Name on the command line.
    target
        ``"module:attribute"``, or ``"/path/to/file.py:attribute"`` for a plugin file.
    parameters
        Fields that differ from their defaults.
    named
        Whether somebody asked for this method, by its name or by passing its file.
    """

    name: str
    target: str
    parameters: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    named: bool = False

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
                f"method '{self.name}' cannot be imported: {error}", f"install what {self.module} needs"
            ) from error
        except AttributeError as error:
            raise ConfigurationError(f"{self.module} has no '{attribute}'", "correct the entry point") from error
        if not isinstance(getattr(found, "info", None), MethodInfo):
            raise ConfigurationError(
                f"{self.target} has no 'info: ClassVar[MethodInfo]'", "see 'Add a method' in the README"
            )
        return cast(type[Any], found)

    def create(self) -> Method | Descriptor:
        """Make the method with its parameters."""
        created = self.load()(**self.parameters)
        if not isinstance(created, (Method, Descriptor)):
            raise ConfigurationError(
                f"{self.target} has neither 'canonicalise' nor 'describe' and 'distances'",
                "see 'Add a method' in the README",
            )
        return created

    @property
    def title(self) -> str:
        """Name in the tables, with the parameters that were chosen."""
        chosen = ", ".join(f"{name}={value}" for name, value in self.parameters.items())
        return self.info.title + (f" ({chosen})" if chosen else "")

    @property
    def info(self) -> MethodInfo:
        """What the method says about itself."""
        return cast(MethodInfo, self.load().info)

    def resolved_parameters(self) -> dict[str, Any]:
        """All parameters, defaults included."""
        created = self.create()
        return (
            {field.name: getattr(created, field.name) for field in dataclasses.fields(created)}
            if dataclasses.is_dataclass(created)
            else {}
        )

    @property
    def learns(self) -> bool:
        """Whether the method is a learner; see :class:`benchmark.learning.Learner`."""
        found = self.load()
        return all(hasattr(found, name) for name in ("train", "load", "model_name", "split"))

    def with_parameter(self, name: str, value: Any) -> MethodSpec:
        """Return the method with one more parameter, called as it would be on the command line."""
        parameters = {**self.parameters, name: value}
        chosen = ",".join(f"{key}={text}" for key, text in parameters.items())
        return dataclasses.replace(self, name=f"{self.base_name}[{chosen}]", parameters=parameters)

    def without_parameter(self, name: str) -> MethodSpec:
        """Return the method with the default of one parameter."""
        plain = dataclasses.replace(self, name=self.base_name, parameters={})
        for key, value in self.parameters.items():
            plain = plain if key == name else plain.with_parameter(key, value)
        return plain

    @property
    def base_name(self) -> str:
        """Name without parameters."""
        return self.name.partition("[")[0]

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
    asked = list(dict.fromkeys(names))
    every = not asked or EVERY in asked
    wanted = [variant(name, known) for name in asked if name != EVERY]
    files = {str(path.resolve()) for path in plugins}
    chosen = []
    for spec in known.values():
        variants = [variant for variant in wanted if variant.target == spec.target]
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
    match = re.fullmatch(r"([^\[\]]+)(?:\[([^\[\]]*)\])?", name)
    if not match or match[1] not in known:
        raise did_you_mean("method", match[1] if match else name, known)
    spec = known[match[1]]
    if match[2] is None:
        return spec
    fields = spec.resolved_parameters()
    parameters: dict[str, Any] = {}
    for assignment in match[2].split(","):
        key, _, text = (part.strip() for part in assignment.partition("="))
        if key not in fields:
            raise did_you_mean(f"parameter of {spec.name}", key, fields)
        parameters[key] = _value(text, fields[key], f"{spec.name}[{key}]")
    return MethodSpec(name, spec.target, parameters)


def _value(text: str, default: Any, what: str) -> Any:
    """Read a value of the type that the default has."""
    try:
        if isinstance(default, bool):
            return {"true": True, "false": False}[text.lower()]
        return text if default is None or isinstance(default, str) else type(default)(text)
    except (ValueError, KeyError, TypeError) as error:
        raise ConfigurationError(f"'{text}' does not fit {what}", f"write a {type(default).__name__}") from error


def plugin_methods(path: Path) -> list[MethodSpec]:
    """Methods defined in a plugin file, in the order of the file."""
    module = import_plugin(str(path.resolve()))
    specs = [
        MethodSpec(info.name, f"{path.resolve()}:{attribute}")
        for attribute, value in vars(module).items()
        if isinstance(value, type) and value.__module__ == module.__name__
        if isinstance(info := getattr(value, "info", None), MethodInfo)
    ]
    if not specs:
        raise ConfigurationError(
            f"plugin {path} defines no method", "give a class an 'info: ClassVar[MethodInfo]' or use @canonical_form"
        )
    return specs


def import_plugin(path: str) -> ModuleType:
    """Import a Python file under a name derived from its path."""
    name = "plugin_" + Path(path).stem
    loaded = sys.modules.get(name)
    if loaded is not None and getattr(loaded, "__file__", None) == path:
        return loaded
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None or not Path(path).is_file():
        raise ConfigurationError(f"plugin {path} is not a Python file", "pass the path of a .py file")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        del sys.modules[name]
        raise ConfigurationError(
            f"plugin {path} cannot be imported: {type(error).__name__}: {error}", "mend the file"
        ) from error
    return module


def _add(found: dict[str, MethodSpec], spec: MethodSpec) -> None:
    if spec.name in found:
        raise ConfigurationError(
            f"two methods are called '{spec.name}': {found[spec.name].target} and {spec.target}", "rename one"
        )
    found[spec.name] = spec
