"""Generated animals and people: the stand-in for TOSCA (Bronstein, Bronstein and Kimmel, 2008).

A body is data: cross sections along chains of bones, as defined in :mod:`.anatomy` (:data:`.generate.SPECIES`). They
define a smooth implicit surface, polygonised once per species (:mod:`.body`). A pose is also data (:mod:`.poses`): it
rotates the bones (:mod:`.skeleton`), the skin follows (:mod:`.skinning`) and then relaxes until its edges nearly regain
their lengths (:mod:`.relaxation`), because TOSCA tests invariance under isometry.
"""

from benchmark.datasets.animals.dataset import CANONICAL_POSE, CLASSES, animals, animals_few, animals_mesh

__all__ = ["CANONICAL_POSE", "CLASSES", "animals", "animals_few", "animals_mesh"]
