"""Targets of a check: a method, a scorer or a data set by name, or all that a plugin file brings."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from benchmark.datasets.catalogue import sources
from benchmark.datasets.own import data_sets_of
from benchmark.errors import ConfigurationError
from benchmark.plugins.registry import MethodSpec, methods, variants
from benchmark.plugins.scorers import ScorerSpec, plugin_scorers, scorer_of, scorers

__all__ = ["Target"]


@dataclass(frozen=True)
class Target:
    """Target of a check.

    Parameters
    ----------
    name
        A method, a scorer, or a data set of a plugin file, or such a file for all that it brings; with parameters in
        brackets if need be.
    methods
        Of a file, the methods to check, with parameters if need be; empty for all, its scorers and its data sets.
    plugins
        Files that bring the named method or data set.
    options
        Of a learner: how to train the model that it is checked with; without any, its own schedule says so, and one
        that says where its model lies is checked with that.
    """

    name: str
    methods: tuple[str, ...] = ()
    plugins: tuple[str, ...] = ()
    options: tuple[tuple[str, str], ...] = ()

    @property
    def file(self) -> Path | None:
        """The plugin file, if it is one."""
        found = re.fullmatch(r"(.*\.py)\s*(\[[^\[\]]*\])?", self.name.strip())
        return Path(found[1]) if found else None

    def specs(self) -> list[MethodSpec]:
        """The methods.

        Raises
        ------
        ConfigurationError
            If there is no such method, a parameter does not fit, or the file cannot be imported.
        """
        path = self.file
        if path is None:
            known = methods(map(Path, self.plugins))
            others = data_sets_of(map(Path, self.plugins)) | self.scorers_named()
            named = [name for name in (self.name, *self.methods) if name not in others]
            return [spec for name in named for spec in variants(name, known)]
        known = methods({path, *map(Path, self.plugins)})
        of_file = [spec.name for spec in known.values() if spec.module == str(path.resolve())]
        brackets = self.name.strip()[len(str(path)) :].strip() if self.name.strip().endswith("]") else ""
        if brackets and self.methods:
            raise ConfigurationError("parameters are given with the file and with -m", "give them with -m")
        if brackets and not of_file:
            raise ConfigurationError(f"plugin {path} has no method that takes parameters", "leave them out")
        found = [spec for name in self.methods or of_file for spec in variants(name + brackets, known)]
        for spec in found:
            if spec.module != str(path.resolve()):
                raise ConfigurationError(f"{path} has no method '{spec.name}'", f"choose from {', '.join(of_file)}")
        return found

    def scorers(self) -> list[ScorerSpec]:
        """The scorers."""
        if self.file is not None:
            return [] if self.methods or self.name.strip().endswith("]") else plugin_scorers(self.file)
        return list(self.scorers_named().values())

    def scorers_named(self) -> dict[str, ScorerSpec]:
        """The scorer of this name, with its parameters, where there is one and no method has it."""
        known, base = scorers(map(Path, self.plugins)), self.name.partition("[")[0].strip()
        is_scorer = base in known and base not in methods(map(Path, self.plugins))
        return {self.name: scorer_of(self.name, known)} if is_scorer else {}

    def data_sets(self) -> dict[str, str]:
        """The data sets, each as :func:`benchmark.datasets.own.open_own` takes it, by name."""
        if self.file is not None:
            own = {} if self.methods or self.name.strip().endswith("]") else data_sets_of([self.file])
            sources(own, [self.file])
            return own
        own = data_sets_of(map(Path, self.plugins))
        return {self.name: own[self.name]} if self.name in own else {}
