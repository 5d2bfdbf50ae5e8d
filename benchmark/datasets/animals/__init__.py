"""Generated animals and people: the stand-in for TOSCA (Bronstein, Bronstein and Kimmel, 2008).

A body is data: cross sections along chains of bones, in the terms of :mod:`.anatomy` (:data:`.generate.SPECIES`). They
make a smooth implicit surface, polygonised once per species (:mod:`.body`). A pose is data too (:mod:`.poses`): it
turns the bones (:mod:`.skeleton`), the skin follows (:mod:`.skinning`) and then relaxes until its edges are nearly as
long as they were (:mod:`.relaxation`), because what TOSCA tests is invariance under isometry.
"""

from benchmark.datasets.animals.dataset import CANONICAL_POSE, CLASSES, Animals, animals_mesh

__all__ = ["CANONICAL_POSE", "CLASSES", "Animals", "animals_mesh"]
