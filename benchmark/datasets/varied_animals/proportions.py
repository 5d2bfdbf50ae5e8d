"""Random proportions of a species: longer legs, a shorter neck, a thicker tail, a larger head."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchmark.datasets.animals.anatomy import Section, Species, Tube

SIZE, LENGTH, GIRTH = 0.08, 0.10, 0.10
"""Standard deviations of the log factors of the whole body, the length of a part, and its girth.

Set by eye: larger values yield unnatural animals, or bodies with holes.
"""

LARGEST = 2.0
"""Truncation of the log factors, in standard deviations."""

SHOULDER = 0.7
"""Height below which the body consists of legs, as a fraction of the height of the pelvis."""

ON_THE_GROUND = frozenset({"fore", "hind", "leg"})
"""Chains on the ground, which scale with the height of the body instead of about their joint."""


@dataclass(frozen=True)
class _Similarity:
    """Similarity from a point p to scale (p - origin) + target."""

    scale: float
    origin: NDArray[np.float64]
    target: NDArray[np.float64]

    def __call__(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        return self.scale * (point - self.origin) + self.target

    def grown(self, about: NDArray[np.float64], factor: float) -> _Similarity:
        """Return the similarity scaled by a factor about a point; the image of that point is unchanged."""
        return _Similarity(factor * self.scale, about, self(about))


def drawn_species(species: Species, random: np.random.Generator) -> Species:
    """Randomise the proportions of a species.

    The whole body is stretched along each axis, and the legs separately. Each other part with bones (neck, head, tail,
    arms, trunk of a centaur) is then scaled about its first joint, together with its attached parts. Girths vary by
    body and by part; paired parts stay symmetric.

    Parameters
    ----------
    species
        The original species.
    random
        Random generator.
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
    """Draw a factor around 1 with truncated deviation."""
    return float(np.exp(deviation * np.clip(random.normal(), -LARGEST, LARGEST)))
