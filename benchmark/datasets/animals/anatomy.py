"""Description of a body: tubes of cross sections along chains of bones.

Lengths are in centimetres. Positions are in the sagittal frame of the animal: ``forward`` (towards the nose), ``up``
(from the ground) and ``side`` (to the animal's left, 0 on the midline). The world has z up and the animal faces -y, as
in TOSCA, so the left of the animal is +x.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Section(NamedTuple):
    """A cross section of a tube.

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
        """Return the section scaled by ``factor``."""
        return Section(self.bone, *(factor * value for value in self[1:]))

    def mirrored(self) -> Section:
        """Return the right counterpart of a left section."""
        bone = self.bone.replace(".left", ".right")
        return self._replace(bone=bone, side=-self.side)


@dataclass(frozen=True, kw_only=True)
class Tube:
    """A part of the body: cross sections along a chain of bones, or soft tissue on a bone of another part.

    Parameters
    ----------
    part
        Name of the part, used by poses for chains; soft tissue also has a name, but no bones.
    parent
        Parent bone of the chain or the tissue; "" for the root.
    sections
        At least two; a section with a bone name is its joint, the last section ends the chain.
    paired
        Whether the part is mirrored to the right side; its bone names then end in ``.left`` and ``.right``.
    blend
        Width of the fillet to the rest of the body.
    flat
        World axis of ``breadth``.
    hollow
        Whether the tube is subtracted from the body instead of added (eye sockets).
    """

    part: str
    parent: str
    sections: tuple[Section, ...]
    paired: bool = False
    blend: float
    flat: tuple[float, float, float] = (1.0, 0.0, 0.0)
    hollow: bool = False

    def scaled(self, factor: float) -> Tube:
        """Return the tube scaled by ``factor``."""
        return replace(self, sections=tuple(s.scaled(factor) for s in self.sections), blend=factor * self.blend)

    def sides(self, bones: frozenset[str]) -> Iterator[Tube]:
        """Yield the tube itself, or its renamed left and right copies.

        Parameters
        ----------
        bones
            Names of the paired bones, to detect a paired parent.
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
    """A body as a tuple of parts; the first part is the trunk with the root bone."""

    name: str
    tubes: tuple[Tube, ...]

    def parts(self) -> tuple[Tube, ...]:
        """Return all tubes, with paired tubes as left and right."""
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
