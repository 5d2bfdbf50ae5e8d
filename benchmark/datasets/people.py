"""Generated people: ``humans``, ``people[draw=0]`` to ``people[draw=2]``, and any number of bodies, ``people[n=500]``.

All sets have the same 20 poses. The fifteen subjects of ``humans`` were selected for large differences in geodesic
distances, which the methods measure. Those of ``people`` follow from a rule and a seed that were committed before any
run (:func:`benchmark.datasets.human_subjects.random_subjects`). The bodies of ``people[n=N]`` keep a distance from all
tested subjects; a larger set begins with the bodies of the smaller one.
"""

from __future__ import annotations

import functools
from collections.abc import Callable

import numpy as np

from benchmark.api.datasets import Entry, ShapeSet
from benchmark.datasets.human_poses import POSES
from benchmark.datasets.human_subjects import PEOPLE, SUBJECTS, Subject, new_subject
from benchmark.datasets.humans import human_mesh, recipe
from benchmark.errors import ConfigurationError

HALF_WIDTH = 1.285
"""Half the width of the depth camera's frame in metres."""

_WIDER = 1.45
"""The same for bodies drawn at random, some of which are taller."""

_SEED, _FEWEST, _MOST = 1, 2, 100_000


def humans() -> ShapeSet:
    """Return the stand-in for SHREC'14 synthetic: 15 subjects x 20 poses."""
    title = "humans (stand-in for SHREC'14 synthetic)"
    return _bodies("humans", title, list(SUBJECTS), SUBJECTS.__getitem__, HALF_WIDTH, "shrec14-synthetic")


def people(draw: int = 0) -> ShapeSet:
    """Return 15 people drawn at random x 20 poses; no subject of another set has the same name."""
    if draw not in range(len(PEOPLE)):
        raise ConfigurationError(f"there is no draw {draw} of people", f"choose 0 to {len(PEOPLE) - 1}")
    drawn = PEOPLE[draw]
    return _bodies(f"people[draw={draw}]", "people drawn at random", list(drawn), drawn.__getitem__, HALF_WIDTH)


def many_people(n: int) -> ShapeSet:
    """Return ``n`` bodies drawn at random x 20 poses."""
    if not _FEWEST <= n <= _MOST:
        raise ConfigurationError(f"people[n={n}] has no such number of bodies", f"choose {_FEWEST} to {_MOST}")
    names = [f"body-{number}" for number in range(n)]
    return _bodies(f"people[n={n}]", f"{n} people drawn at random", names, _body, _WIDER)


@functools.lru_cache(maxsize=_MOST)
def _body(subject: str) -> Subject:
    number = int(subject.removeprefix("body-"))
    return new_subject(np.random.default_rng([_SEED, number]), kind=number % 3)


def _bodies(
    name: str,
    title: str,
    subjects: list[str],
    body: Callable[[str], Subject],
    half_width: float,
    stand_in_for: str = "",
) -> ShapeSet:
    return ShapeSet(
        name=name,
        title=title,
        shapes=tuple(Entry(f"{subject}_{pose}", subject, pose) for subject in subjects for pose in POSES),
        load=lambda entry: human_mesh(body(entry.subject), POSES[entry.pose]),
        key=lambda entry: recipe(body(entry.subject), POSES[entry.pose]),
        half_width=half_width,
        stand_in_for=stand_in_for,
        code=("benchmark.datasets.humans",),
    )
