"""Training animals with random proportions in mixtures of authored poses, none of them in a data set.

The proportions of a species of :mod:`benchmark.datasets.animals` are randomised (:mod:`.proportions`), its bones take a
mixture of two authored poses (:mod:`.motion`), and body and skin are generated as in the data set (:mod:`.sampler`).
"""

from benchmark.datasets.varied_animals.sampler import SPECIES_IN_TURN, AnimalSampler

__all__ = ["SPECIES_IN_TURN", "AnimalSampler"]
