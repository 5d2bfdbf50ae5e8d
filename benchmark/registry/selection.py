"""Selection of methods by name, with parameters in brackets, or by object."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, get_args

from benchmark.defaults import ALL_METHODS
from benchmark.errors import ConfigurationError
from benchmark.registry.components import Component, Kind, component_of
from benchmark.registry.known import by_name, in_file
from benchmark.registry.names import combinations, split_parameters


def select(names: Iterable[Any] = (), plugins: Iterable[Path] = ()) -> list[Component]:
    """Return the methods that a user selects, those of the suite in the order of the tables.

    Parameters
    ----------
    names
        Names of methods. A name may have parameters with one or more values, as in
        ``"fast-mds[sweeps=1|5]"``; ``"all"`` stands for all methods. A Python program may also pass
        objects, classes, and functions from a shape to positions. If nothing is named, the methods
        of the plugin files are selected, or all methods if there are no files.
    plugins
        Plugin files. If no method of a file is named, all methods of the file are selected.

    Raises
    ------
    ConfigurationError
        If a name or a parameter is unknown, a value is invalid, or two methods have one name.
    """
    known = by_name("method", plugins)
    chosen: list[Component] = []
    for name in names:
        if not isinstance(name, str):
            chosen.append(_new_object(name, known))
        elif name.strip() == ALL_METHODS:
            chosen += known.values()
        else:
            chosen += variants(name, known)

    # All methods of each plugin file from which none was named.
    named_files = {component.plugin for component in chosen}
    for component in known.values():
        if component.plugin and component.plugin not in named_files:
            chosen.append(component)

    # In the order of the tables; objects of the user, which are not known, come last.
    places = {name: place for place, name in enumerate(known)}
    chosen.sort(key=lambda component: places.get(component.base_name, len(places)))

    # A method that is named twice is selected once.
    selected: dict[str, Component] = {}
    for component in chosen or known.values():
        same_name = selected.setdefault(component.name, component)
        if same_name != component:
            raise ConfigurationError(f"two methods are called '{component.name}'", "rename one")
        if not component.is_fixed:  # it stands for more rows than the same one with parameters
            selected[component.name] = component
    return list(selected.values())


def _new_object(value: Any, known: Mapping[str, Component]) -> Component:
    """Return the component for an object; raise if it has the name of another method."""
    component = component_of(value)
    name = component.base_name
    if name in known and known[name].load() is not component.load():
        problem = f"there is another method '{name}', {known[name].target}"
        raise ConfigurationError(problem, "rename yours")
    return component


def are_named(names: Sequence[Any]) -> bool:
    """Return whether methods are selected by their names, so that others do not count."""
    return bool(names) and ALL_METHODS not in names


def select_one(name: str, plugins: Iterable[Path] = (), kind: Kind = "method") -> Component:
    """Return the only method or scorer for a name with parameters in brackets.

    Raises
    ------
    ConfigurationError
        If the name or a parameter is unknown, a value is invalid, or the name stands for several.
    """
    first, *others = variants(name, by_name(kind, plugins))
    if others:
        problem = f"'{name}' stands for {len(others) + 1} {kind}s"
        raise ConfigurationError(problem, f"name one: {first.name}")
    return first


def variants(name: str, known: Mapping[str, Component]) -> list[Component]:
    """Return the components that a name stands for: one for each combination of its parameters.

    Parameters
    ----------
    name
        Such as ``"fast-mds[sweeps=1|5]"``, which stands for two components.
    known
        Components by name; looking up an unknown name raises an error.

    Raises
    ------
    ConfigurationError
        If the name or a parameter is unknown, or a combination of values is invalid.
    """
    base, inside = split_parameters(name)
    component = known[base]
    variants_by_name: dict[str, Component] = {}
    for parameters in combinations(inside):
        variant = component.with_parameters(parameters) if parameters else component
        variants_by_name[variant.name] = variant
    for variant in variants_by_name.values():
        if variant.parameters and not variant.missing_packages():
            variant.create()  # lets the class refuse invalid combinations now
    return list(variants_by_name.values())


def components_named(name: str, plugins: Iterable[Path] = ()) -> list[Component]:
    """Return all methods and scorers of a name, or all that a plugin file defines.

    Parameters
    ----------
    name
        A name, or the path of a plugin file; both optionally with parameters in brackets, which
        methods take; those of a file without methods are taken by its scorers.
    plugins
        Plugin files that may define the name.

    Raises
    ------
    ConfigurationError
        If there is nothing of this name, or a parameter is unknown or invalid.
    """
    base, parameters = split_parameters(name)
    if base.endswith(".py"):
        return _in_file_with(Path(base), parameters)
    methods = by_name("method", plugins)
    scorers = by_name("scorer", plugins)
    components: list[Component] = []
    if base in scorers:
        components += variants(name, scorers)
    if base in methods or not components:  # an unknown name raises an error here
        components = variants(name, methods) + components
    return components


def _in_file_with(path: Path, parameters: str) -> list[Component]:
    """Return the components of a plugin file; with parameters those that take them.

    These are its methods, or its scorers if it has no methods.
    """
    components = in_file(path)
    for kind in get_args(Kind):
        by_name(kind, [path])  # which refuses two of one name, also beside those of the suite
    if not parameters:
        return components
    methods = [component for component in components if component.kind == "method"]
    taking = {component.name: component for component in methods or components}
    selected: list[Component] = []
    for name in taking:
        selected += variants(f"{name}[{parameters}]", taking)
    return selected
