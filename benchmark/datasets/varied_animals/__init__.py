"""Animals of random proportions in poses between the authored ones: data to train on, none of them of a data set.

A species of :mod:`benchmark.datasets.animals` is redrawn (:mod:`.proportions`), its bones go somewhere between two
authored poses (:mod:`.motion`), and body and skin are made as those of the set are (:mod:`.sampler`).
"""

from benchmark.datasets.varied_animals.sampler import SPECIES_IN_TURN, AnimalSampler

__all__ = ["SPECIES_IN_TURN", "AnimalSampler"]
