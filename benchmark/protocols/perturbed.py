"""Galleries under a perturbation: which ones a table is made of, what they are given, what they are called."""

from __future__ import annotations

from benchmark.api.contracts import Input
from benchmark.datasets.catalogue import CATALOGUE, FRAME_SETS, is_known, open_dataset, table_name
from benchmark.datasets.perturbations.dataset import PERTURBATIONS, STRENGTHS, parsed, perturbed_name

__all__ = ["conditions", "inputs_of", "own_table_name"]


def conditions(name: str) -> list[str]:
    """A clean set, and the same set under each perturbation at each strength, by name or path."""
    fitting = [each for each, known in PERTURBATIONS.items() if bool(known.of_frames) == (name in FRAME_SETS)]
    return [name, *(perturbed_name(name, each, strength) for each in fitting for strength in STRENGTHS)]


def inputs_of(dataset: str, inputs: tuple[Input, ...]) -> tuple[Input, ...]:
    """Inputs under which a data set is ranked: those of its table that its perturbation is made for."""
    found = parsed(dataset)
    return tuple(input_ for input_ in inputs if not found or input_ in PERTURBATIONS[found[1]].inputs)


def own_table_name(name: str) -> str:
    """Name of the table of a set that no other table uses: that of the set, also where it is given by a path."""
    if found := parsed(name):
        return perturbed_name(own_table_name(found[0]), *found[1:])
    if is_known(name) and name not in CATALOGUE:
        return open_dataset(name, None).name
    return table_name(name)
