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
    """Return the selected methods, those of the suite in the order of the tables.

    Parameters
    ----------
    names
        Names, optionally with parameters, of which ``|`` separates several values:
        ``"fast-mds[sweeps=1|5]"``; ``"all"`` stands for all methods. In Python also objects,
        classes and functions from a shape to positions. Without any, the methods of the plugin
        files, or all methods if there are none.
    plugins
        Plugin files; if no method of a file is named, all of them are added.

    Raises
    ------
    ConfigurationError
        If a name or a parameter is unknown, a value is invalid, or two methods have one name.
    """
    known = by_name("method", plugins)
    chosen: list[Component] = []
    for name in names:
        if not isinstance(name, str):
            chosen.append(component_of(name))
            if (base := chosen[-1].base_name) in known and known[base].load() is not chosen[
                -1
            ].load():
                raise ConfigurationError(
                    f"there is another method '{base}', {known[base].target}", "rename yours"
                )
        else:
            chosen += known.values() if name.strip() == ALL_METHODS else variants(name, known)
    named = {component.plugin for component in chosen}
    chosen += [
        component
        for component in known.values()
        if component.plugin and component.plugin not in named
    ]
    order = list(known)
    chosen.sort(
        key=lambda component: (
            order.index(component.base_name) if component.base_name in known else len(order)
        )
    )
    selected: dict[str, Component] = {}
    for component in chosen or known.values():
        if selected.setdefault(component.name, component) != component:
            raise ConfigurationError(f"two methods are called '{component.name}'", "rename one")
    return [*selected.values()]


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
        raise ConfigurationError(
            f"'{name}' stands for {len(others) + 1} {kind}s", f"name one: {first.name}"
        )
    return first


def variants(name: str, known: Mapping[str, Component]) -> list[Component]:
    """Return the components for a name with parameters, one for each combination of their values, each once."""
    base, inside = split_parameters(name)
    component = known[base]
    chosen = [
        component.with_parameters(given) if given else component for given in combinations(inside)
    ]
    for variant in chosen:
        if variant.parameters and not variant.missing_packages():
            variant.create()  # lets the class refuse invalid combinations now
    return list({variant.name: variant for variant in chosen}.values())


def find(name: str, plugins: Iterable[Path] = ()) -> list[Component]:
    """Return the components of a plugin file, or the methods and scorers of a name, for ``check``.

    Parameters
    ----------
    name
        Path of a plugin file, or a name; both optionally with parameters in brackets, which methods
        take.
    plugins
        Plugin files.

    Raises
    ------
    ConfigurationError
        If there is nothing of this name, or a parameter is unknown or invalid.
    """
    base, inside = split_parameters(name)
    if base.endswith(".py"):
        components = in_file(Path(base))
        own = {component.name: component for component in components if component.kind == "method"}
        return (
            [variant for c in own for variant in variants(f"{c}[{inside}]", own)]
            if inside
            else components
        )
    groups = [by_name(kind, plugins) for kind in get_args(Kind)]
    having = [known for known in groups if base in known] or groups[
        :1
    ]  # which says what an unknown name may mean
    return [component for known in having for component in variants(name, known)]
