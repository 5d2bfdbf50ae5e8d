"""Fresh bodies in the poses of the wide stream, as complete surfaces."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from benchmark.api.streaming import Surfaces
from benchmark.datasets.varied.coarse import Resting, coarse_model
from benchmark.datasets.varied.model import CANONICAL
from benchmark.datasets.varied.sampler import drawn_bodies
from benchmark.datasets.varied.wide import WideSampler
from benchmark.geometry.mesh import Points


@dataclass(frozen=True, kw_only=True)
class WideBodies(WideSampler):
    """Makes batches; see :class:`benchmark.datasets.varied.wide.WideSampler`, with which it shares no body."""

    def surfaces(self, number: int, bodies: int) -> Surfaces:
        """Make one batch; see :class:`benchmark.api.streaming.MakesSurfaces`."""
        model, again = coarse_model(self.triangles), Counter[str]()
        names = [f"scanned-{self.seed}-{number}-{place}" for place in range(bodies)]
        # A number other than those of the two streams of images, so that no body of theirs comes here.
        randoms = [np.random.default_rng([self.seed, number, place, 2]) for place in range(bodies)]

        def standing(candidates: Sequence[Resting]) -> Iterable[Points]:
            return model.posed(candidates, np.tile(CANONICAL.angles(), (len(candidates), 1)))

        drawn, shapes = drawn_bodies(model.shaped, standing, model.faces, names, randoms, again)
        return Surfaces(
            identifiers=tuple(names),
            canonical=np.stack(shapes),
            posed=self._posed(model, names, drawn, shapes, randoms, again),
            faces=model.faces,
            drawn_again=dict(again),
        )
