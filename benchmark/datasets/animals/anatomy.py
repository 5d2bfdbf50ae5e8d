"""Description of a body: tubes of cross sections along chains of bones.

Lengths are centimetres. Positions are given in the sagittal frame of the animal: ``forward`` (towards the nose), ``up``
(from the ground) and ``side`` (to the animal's left, 0 on the midline). The world has z up and the animal faces -y, as
in TOSCA, so that the left of the animal is +x.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Section(NamedTuple):
    """One cross section of a tube.

    Parameters
    ----------
    bone
        Bone that starts here, or "" between two joints.
    forward, up, side
        Centre of the section.
    depth
        Half extent across the tube.
    breadth
        Half extent along the tube's ``flat`` axis.
    """

    bone: str
    forward: float
    up: float
    side: float
    depth: float
    breadth: float

    @property
    def position(self) -> NDArray[np.float64]:
        """Centre in world coordinates, shape (3,)."""
        return np.array([self.side, -self.forward, self.up])

    def scaled(self, factor: float) -> Section:
        """Return the section of a body that is ``factor`` times as large."""
        return Section(self.bone, *(factor * value for value in self[1:]))

    def mirrored(self) -> Section:
        """Return the section of the right side that belongs to this one of the left."""
        bone = self.bone.replace(".left", ".right")
        return self._replace(bone=bone, side=-self.side)


@dataclass(frozen=True, kw_only=True)
class Tube:
    """A part of the body: cross sections along a chain of bones, or a mass of flesh on one bone of another part.

    Parameters
    ----------
    part
        Name of the chain, by which poses address it; a mass of flesh has a name too, but no bones of its own.
    parent
        Bone that the chain hangs on, or that carries the flesh; "" for the root.
    sections
        At least two; a section that names a bone is its joint, the last one ends the chain.
    paired
        Whether the right side has its mirror image. The names of its bones then get ``.left`` and ``.right``.
    blend
        Width of the fillet to the rest of the body.
    flat
        World axis along which ``breadth`` is measured.
    hollow
        Whether the tube is taken away from the body instead of added: eye sockets.
    """

    part: str
    parent: str
    sections: tuple[Section, ...]
    paired: bool = False
    blend: float
    flat: tuple[float, float, float] = (1.0, 0.0, 0.0)
    hollow: bool = False

    def scaled(self, factor: float) -> Tube:
        """Return the tube of a body that is ``factor`` times as large."""
        return replace(self, sections=tuple(s.scaled(factor) for s in self.sections), blend=factor * self.blend)

    def sides(self, bones: frozenset[str]) -> Iterator[Tube]:
        """Yield the tube itself, or its left and right copies with their own names.

        Parameters
        ----------
        bones
            Names of the bones that exist on both sides, to tell whether the parent is one of a pair.
        """
        if not self.paired:
            yield self
            return
        for side in ("left", "right"):
            named = [s._replace(bone=f"{s.bone}.left") if s.bone else s for s in self.sections]
            sections = named if side == "left" else [s.mirrored() for s in named]
            flat = self.flat if side == "left" else (-self.flat[0], self.flat[1], self.flat[2])
            parent = f"{self.parent}.{side}" if self.parent in bones else self.parent
            yield replace(self, part=f"{self.part}.{side}", parent=parent, sections=tuple(sections), flat=flat)


@dataclass(frozen=True)
class Species:
    """A body, as the parts that it consists of; the first one is the trunk and holds the root bone."""

    name: str
    tubes: tuple[Tube, ...]

    def parts(self) -> tuple[Tube, ...]:
        """All tubes, the paired ones as left and right."""
        pairs = frozenset(s.bone for tube in self.tubes if tube.paired for s in tube.sections if s.bone)
        return tuple(copy for tube in self.tubes for copy in tube.sides(pairs))


def tube(
    part: str,
    parent: str,
    *rows: tuple[str, float, float, float, float, float],
    blend: float,
    paired: bool = False,
    flat: tuple[float, float, float] = (1.0, 0.0, 0.0),
    hollow: bool = False,
) -> Tube:
    """Build a tube from bare rows (bone, forward, up, side, depth, breadth); see :class:`Section`."""
    sections = tuple(Section(*row) for row in rows)
    return Tube(part=part, parent=parent, sections=sections, paired=paired, blend=blend, flat=flat, hollow=hollow)
