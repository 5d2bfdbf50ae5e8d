"""Rows whose sample came out the same under two trees, and what speaks against the others."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from benchmark.jobs.plan import difference
from benchmark.jobs.rekey.changes import NEW, OLD, Change
from benchmark.jobs.rekey.sampling import STAGES
from benchmark.storage import keys
from benchmark.storage.records import Place, place
from benchmark.system.arrays import load_arrays

#: Parts of a recipe that may differ where no digit does: text of the code, and digests that hold some of it.
_OF_CODE = frozenset({"code", "gallery", "view"})

#: Last stage that has to be compared where the code of a stage differs.
_LAST = {"source": "mesh", "preparation": "prepared", "method": "form"}


@dataclass
class Candidate:
    """A record that may move, and what is known of it so far.

    Parameters
    ----------
    record
        The record.
    old, new
        What either tree answers of it; see :mod:`benchmark.jobs.rekey.sampling`.
    problem
        What speaks against it; "" for nothing.
    """

    record: Mapping[str, Any]
    old: Mapping[str, Any]
    new: Mapping[str, Any]
    problem: str = ""
    shapes: tuple[str, ...] = ()
    changes: list[Change] = field(default_factory=list)

    @property
    def place(self) -> Place:
        """Return where the record belongs in tables."""
        return place(self.record)

    @property
    def is_current(self) -> bool:
        """Return whether the record has the key that this code gives it."""
        return bool(self.new.get("key") == self.record["key"])

    def modules(self, tree: int) -> frozenset[str]:
        """Names of the modules in its recipe."""
        return self._modules[tree]

    @cached_property
    def _modules(self) -> list[frozenset[str]]:
        codes = (each["recipe"]["code"].values() for each in (self.old, self.new))
        return [frozenset(name for stage in code for name in stage["code"]) for code in codes]

    @property
    def last(self) -> str:
        """Last stage whose code, or what it gets, differs between the trees."""
        code = [each["recipe"]["code"] for each in (self.old, self.new)]
        differing = [name for name in code[OLD].keys() | code[NEW].keys() if code[OLD].get(name) != code[NEW].get(name)]
        return max((_LAST.get(name, "measures") for name in differing), key=STAGES.index, default="mesh")

    def check_recipes(self, commit: str) -> None:
        """Take note of what no sample can excuse: other packages, parameters or data than the record was made with."""
        for answer in (self.old, self.new):
            if "error" in answer:
                self.problem = f"it cannot be planned here: {answer['error']}"
                return
        if self.old["key"] != self.record["key"]:
            self.problem = f"{commit} did not make it here: {difference(self.record['recipe'], self.old['recipe'])}"
            return
        recipes = [{name: part for name, part in each["recipe"].items() if name not in _OF_CODE}
                   for each in (self.old, self.new)]  # fmt: skip
        packages = [_packages(each["recipe"]) for each in (self.old, self.new)]
        if keys.plain(recipes[OLD]) != keys.plain(recipes[NEW]):
            self.problem = f"more than code changed: {difference(recipes[OLD], recipes[NEW])}"
            return
        both = packages[OLD].keys() & packages[NEW].keys()
        if wrong := [name for name in sorted(both) if packages[OLD][name] != packages[NEW][name]]:
            self.problem = f"packages differ: {', '.join(wrong)}"

    def compare(self, old: Mapping[str, Any], new: Mapping[str, Any], arrays: Path) -> None:
        """Compare what both trees made of the sample, stage by stage; the first difference counts.

        Parameters
        ----------
        old, new
            Answers with ``stages``.
        arrays
            Folder of the arrays of both.
        """
        for answer in (old, new):
            if "error" in answer:
                self.problem = f"the sample cannot be made: {answer['error']}"
                return
        for stage in STAGES:
            before, now = old["stages"].get(stage, {}), new["stages"].get(stage, {})
            for name in dict.fromkeys([*before, *now]):
                one, other = before.get(name, ["nothing", ""]), now.get(name, ["nothing", ""])
                if one[0] != other[0]:
                    self.problem = f"{stage}{name and ' of ' + name} differs: {_size(one, other, arrays)}"
                    return
                if one[0].startswith("raises"):
                    self.problem = f"{stage}{name and ' of ' + name} {one[0]}"
                    return
        self.shapes = tuple(dict.fromkeys(new["stages"].get("mesh", {})))

    def check_coverage(self, unreached: Iterable[Change]) -> None:
        """Take note of changes that no sample has reached and that its stages can reach."""
        missing = [change for change in unreached if change.module in self.modules(change.tree)]
        if missing and not self.problem:
            self.problem = f"no sample runs {missing[0].told}" + (
                f" and {len(missing) - 1} others" if missing[1:] else ""
            )


def _packages(recipe: Mapping[str, Any]) -> dict[str, str]:
    return {name: version for stage in recipe["code"].values() for name, version in stage["packages"].items()}


def _size(old: Sequence[str], new: Sequence[str], folder: Path) -> str:
    """Size of the difference between two outcomes of a stage."""
    if not (old[1] and new[1]):
        return f"{_words(old[0])}, now {_words(new[0])}"
    try:
        before, now = (_arrays(folder, key) for key in (old[1], new[1]))
    except Exception:  # the file of a tree that writes others
        return "in its bits"
    for name in dict.fromkeys([*before, *now]):
        if name.startswith("__"):
            continue
        if name not in before or name not in now or before[name].shape != now[name].shape:
            shapes = [str(each[name].shape) if name in each else "nothing" for each in (before, now)]
            return f"'{name}' is {shapes[NEW]}, was {shapes[OLD]}"
        if before[name].dtype.kind in "biuf" and (before[name] != now[name]).any():
            with np.errstate(invalid="ignore", over="ignore"):
                size = np.abs(before[name].astype(np.float64) - now[name].astype(np.float64))
            scale = float(np.nanmax(np.abs(before[name].astype(np.float64)), initial=0.0))
            return f"'{name}' by up to {np.nanmax(size, initial=0.0):.3g}, where the largest number is {scale:.3g}"
        if before[name].tobytes() != now[name].tobytes():
            return f"'{name}' in its bits"
    return "in its bits"


def _words(outcome: str) -> str:
    return outcome if " " in outcome or outcome == "nothing" else "a result"


def _arrays(folder: Path, key: str) -> dict[str, Any]:
    for part in ("artefacts", "scratch"):
        path = folder / part / key[:2] / f"{key}.npz"
        if path.is_file():
            return load_arrays(path, key)
    raise FileNotFoundError(key)
