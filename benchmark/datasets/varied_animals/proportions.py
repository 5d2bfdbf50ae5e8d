"""A species redrawn with other proportions: longer legs, a shorter neck, a thicker tail, a larger head."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchmark.datasets.animals.anatomy import Section, Species, Tube

SIZE, LENGTH, GIRTH = 0.08, 0.10, 0.10
"""Standard deviations of the logarithms of factors: of the whole body, of the length of a part, and of its girth.

Set by eye: wider ones give animals that nobody has seen, or bodies with holes.
"""

LARGEST = 2.0
"""Standard deviations beyond which a factor is not drawn."""

SHOULDER = 0.7
"""Height of the joints of the trunk, as a share of the pelvis's, below which a body is legs."""

ON_THE_GROUND = frozenset({"fore", "hind", "leg"})
"""Chains that stand on the ground: they grow with the height of the body, not from their joint."""


@dataclass(frozen=True)
class _Similarity:
    """Takes a point p to scale (p - origin) + target."""

    scale: float
    origin: NDArray[np.float64]
    target: NDArray[np.float64]

    def __call__(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        return self.scale * (point - self.origin) + self.target

    def grown(self, about: NDArray[np.float64], factor: float) -> _Similarity:
        """The same, with everything around a point larger by a factor; that point goes where it went."""
        return _Similarity(factor * self.scale, about, self(about))


def drawn_species(species: Species, random: np.random.Generator) -> Species:
    """Redraw a species.

    The whole body is stretched along each axis, and the legs by themselves. Each other part with bones (neck, head,
    tail, arms, trunk of a centaur) is then scaled about its first joint and carries along what hangs on it. Girths vary
    by body and by part; paired parts stay alike.

    Parameters
    ----------
    species
        The animal as it is written down.
    random
        Source of chance.
    """
    size = _factor(random, SIZE)
    forward, side = size * _factor(random, LENGTH), size * _factor(random, GIRTH)
    up, legs = size * _factor(random, LENGTH), _factor(random, LENGTH)
    girth = size * _factor(random, GIRTH)
    knee = SHOULDER * species.tubes[0].sections[0].up

    def stretched(section: Section) -> Section:
        height = section.up + (legs - 1.0) * min(section.up, knee)
        bone, at, depth, breadth = section.bone, section.forward, section.depth, section.breadth
        return Section(bone, forward * at, up * height, side * section.side, girth * depth, girth * breadth)

    carriers: dict[str, _Similarity] = {"": _Similarity(1.0, np.zeros(3), np.zeros(3))}
    tubes = []
    for tube in species.tubes:
        sections = [stretched(section) for section in tube.sections]
        first = np.array(sections[0][1:4])
        chain = any(section.bone for section in sections)
        grows = chain and bool(tube.parent) and tube.part not in ON_THE_GROUND
        length = _factor(random, LENGTH) if grows else 1.0
        thickness = _factor(random, GIRTH)
        carrier = carriers[tube.parent].grown(first, length)
        tubes.append(_carried(tube, sections, carrier, thickness, size))
        carriers.update({section.bone: carrier for section in sections if section.bone})
    return Species(species.name, tuple(tubes))


def _carried(tube: Tube, sections: list[Section], carrier: _Similarity, thickness: float, size: float) -> Tube:
    wide = carrier.scale * thickness

    def moved(section: Section) -> Section:
        forward, up, side = (float(value) for value in carrier(np.array(section[1:4])))
        return Section(section.bone, forward, up, side, wide * section.depth, wide * section.breadth)

    return replace(tube, sections=tuple(map(moved, sections)), blend=size * carrier.scale * tube.blend)


def _factor(random: np.random.Generator, deviation: float) -> float:
    """A factor around 1, no further off than some deviations."""
    return float(np.exp(deviation * np.clip(random.normal(), -LARGEST, LARGEST)))
