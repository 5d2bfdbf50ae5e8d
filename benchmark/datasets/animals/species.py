"""Proportions of the six animals.

The numbers are our own: drawn from general knowledge of each animal's build and set by eye. Only the overall size
follows TOSCA's (Bronstein, Bronstein and Kimmel, 2008), so that the stand-in has the same scale.

Each row of a tube is (bone, forward, up, side, depth, breadth) in centimetres; see :mod:`.anatomy`.
"""

from __future__ import annotations

from benchmark.datasets.animals.apes import GORILLA
from benchmark.datasets.animals.carnivores import CAT, DOG, WOLF
from benchmark.datasets.animals.hoofed import CENTAUR, HORSE

SPECIES = {species.name: species for species in (CAT, CENTAUR, DOG, GORILLA, HORSE, WOLF)}
"""The generated bodies, by class name."""
