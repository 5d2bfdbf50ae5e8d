"""Robustness of methods: curves over the strength of each perturbation, a pure function of records."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from benchmark.api.contracts import Input
from benchmark.datasets.perturbations.dataset import PERTURBATIONS, STRENGTHS, parsed
from benchmark.methods.registry import BUILT_IN
from benchmark.protocols.tables import INPUTS
from benchmark.report.content import stem
from benchmark.report.results import Result
from benchmark.storage.records import Record, chance_of, coverage_of

__all__ = ["Curve", "Robustness", "robustness"]


@dataclass(frozen=True)
class Curve:
    """A method under one perturbation.

    Parameters
    ----------
    clean
        Its NN without the perturbation.
    values
        Its NN at each strength; None where there is no result. A shape that was destroyed counts as a query without
        success.
    unsupported
        Shapes that were destroyed, at each strength.
    chance
        NN of a random ranking.
    amounts
        What the strengths are.
    """

    clean: float
    values: tuple[float | None, ...]
    unsupported: tuple[int | None, ...]
    chance: float
    amounts: tuple[float, ...]

    @property
    def can_halve(self) -> bool:
        """Return whether half of the clean value is above chance, so that falling below it means something."""
        return self.clean / 2 > self.chance

    @property
    def half_at(self) -> float | None:
        """Amount of the weakest strength at which NN is below half of its clean value.

        None where there is none, or a weaker strength has no result.
        """
        for amount, value in zip(self.amounts, self.values, strict=True):
            if value is None or not self.can_halve:
                return None
            if value < self.clean / 2:
                return amount
        return None

    @property
    def is_complete(self) -> bool:
        """Return whether there is a result at each strength."""
        return None not in self.values


@dataclass(frozen=True)
class Robustness:
    """All methods on one data set under one input.

    Parameters
    ----------
    data
        Name of the clean set.
    input
        What the methods were given.
    n_shapes
        Shapes of the clean set.
    scorer
        What compared the forms; "" for the default scorer.
    titles
        Title of each method by its name, in the order of the tables.
    curves
        By perturbation and method.
    """

    data: str
    input: Input
    n_shapes: int
    scorer: str
    titles: Mapping[str, str]
    curves: Mapping[str, Mapping[str, Curve]]

    @property
    def file_stem(self) -> str:
        """Name of its files."""
        return stem("robustness", self.data, self.input, self.scorer)


def robustness(results: Iterable[Result]) -> list[Robustness]:
    """Collect the curves of each data set and input that has results under some perturbation, and clean ones.

    Parameters
    ----------
    results
        Records of clean and perturbed galleries, among others.
    """
    clean: dict[tuple[str, str, str], Record] = {}
    perturbed: dict[tuple[str, str], dict[tuple[str, int, str], Record]] = {}
    for result in results:
        record = result.record
        if found := parsed(record["data"]["name"]):
            base, perturbation, strength = found
            if record["data"]["quick"]:
                base += " (quick)"
            perturbed.setdefault((base, record["input"]), {})[perturbation, strength, record["method"]] = record
        else:
            clean[record["gallery"], record["input"], record["method"]] = record
    made = (
        _of_set(base, input_, perturbed[base, input_], clean)
        for base, input_ in sorted(perturbed, key=lambda place: (place[0], INPUTS.index(place[1])))
    )
    return [found for found in made if found.curves]


def _of_set(
    base: str,
    input_: str,
    records: Mapping[tuple[str, int, str], Record],
    clean: Mapping[tuple[str, str, str], Record],
) -> Robustness:
    of_methods = {method: clean[base, input_, method] for _, _, method in records if (base, input_, method) in clean}
    ok = {name: of_methods[name] for name in sorted(of_methods, key=_table_order) if of_methods[name]["status"] == "ok"}
    curves: dict[str, dict[str, Curve]] = {}
    for perturbation, known in PERTURBATIONS.items():
        for method, record in ok.items():
            found = [records.get((perturbation, strength, method)) for strength in STRENGTHS]
            if any(found):
                curves.setdefault(perturbation, {})[method] = Curve(
                    _counted(record) or 0.0,
                    tuple(_counted(each) for each in found),
                    tuple(len(each.get("unsupported", ())) if each else None for each in found),
                    chance_of(record)["NN"],
                    known.amounts,
                )
    n_shapes = max((record["data"]["n_shapes"] for record in ok.values()), default=0)
    scorer = next((record["scorer"] for record in ok.values() if "scorer_title" in record), "")
    return Robustness(base, input_, n_shapes, scorer, {m: r["title"] for m, r in ok.items()}, curves)  # type: ignore[arg-type]


def _table_order(method: str) -> tuple[int, str]:
    """Built-in methods in the order of the tables, then all others by name."""
    names = list(BUILT_IN)
    base = method.partition("[")[0]
    return (names.index(base) if base in BUILT_IN else len(names)), method


def _counted(record: Record | None) -> float | None:
    """NN over all shapes: one that was destroyed finds nothing."""
    if record is None:
        return None
    if record["status"] == "unsupported":
        return 0.0  # no shape was left to rank
    if record["status"] != "ok":
        return None
    # Records of before did not count what was refused.
    return float(record["scores"]["NN"]) * (1.0 if "coverage" in record else coverage_of(record))


def worst(found: Robustness, perturbation: str) -> Sequence[int]:
    """Largest number of destroyed shapes at each strength, over the methods."""
    curves = found.curves[perturbation].values()
    return [max(curve.unsupported[k] or 0 for curve in curves) for k in range(len(STRENGTHS))]
