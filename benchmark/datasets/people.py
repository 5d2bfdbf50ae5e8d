"""Generated people: ``people[draw=0]`` to ``[draw=2]``, ``people[n=500]``, ``humans-scanlike``.

The subjects of ``people`` follow from a rule and a seed that were committed before any run, see
``tests/datasets/test_people.py``. The bodies of ``people[n=N]`` keep a distance from all tested
subjects, those of the earlier set ``humans`` included; a larger set begins with the bodies of the
smaller one. The adults of ``humans-scanlike`` are evenly distributed in phenotype space by an
additive recurrence [Roberts 2018]. All sets but the last have the same 20 poses.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable, Iterable
from dataclasses import astuple
from typing import Any

import numpy as np

from benchmark.api.datasets import Entry, ShapeSet
from benchmark.datasets.bodies import (
    CAVITIES,
    POSES,
    SUBJECTS,
    Subject,
    body_mesh,
    describe_body,
    jittered,
    named_random,
)
from benchmark.errors import ConfigurationError
from benchmark.files import file_digest
from benchmark.geometry.mesh import FloatArray, Mesh

TESTED = ("humans", "humans-scanlike", "people")
"""Generated test sets of people; ``humans``, which ``people`` replaced, has subjects alone."""

JUDGES = "people[n=12]"
"""Bodies that no table holds, on which experiments compare networks."""

N_JUDGES = 12

CLEARANCE = 0.25
"""Minimum Euclidean distance in phenotype space between a training body and any test subject."""

PEOPLE = tuple(SUBJECTS[f"people[draw={draw}]"] for draw in range(3))
"""Subjects of ``people`` by draw."""

#: Range of the age of children; see :class:`~benchmark.datasets.bodies.Subject`.
_CHILDREN = (0.26, 0.48)
#: Range of the age of adults.
_ADULTS = (0.60, 1.0)
#: Least muscle, weight, height and proportions, which leave out emaciated bodies.
_LOWEST = (0.15, 0.14, 0.08, 0.12)

#: Largest muscle, weight, height and proportions, which leave out bodies above two metres.
_HIGHEST = (0.95, 0.95, 0.60, 0.95)

#: Half the width of the depth camera's frame for ``people``, in metres.
_HALF_WIDTH = 1.285

#: The same for ``people[n=N]``, some of whose bodies are taller.
_HALF_WIDTH_OF_MANY = 1.45

#: The same for ``humans-scanlike``.
_HALF_WIDTH_OF_SCANS = 1.345

#: Seed of the bodies of ``people[n=N]``.
_SEED = 1

#: Fewest and most bodies of ``people[n=N]``.
_FEWEST = 2
_MOST = 100_000

#: Poses without contact, which a scanner would fuse; the first is the canonical pose.
_SCANNED_POSES = (
    "standing",
    "walking",
    "running",
    "arms-up",
    "t-pose",
    "dancing",
    "lunging",
    "kicking",
    "waving",
    "throwing",
)

#: Standard deviation of a scanned person's joint angles from the pose, in degrees.
_POSE_DEVIATION = 3.0


def people(draw: int = 0) -> ShapeSet:
    """Return 15 people drawn at random x 20 poses; no subject of another set has the same name."""
    bodies = PEOPLE[draw]
    return _bodies(
        list(bodies),
        bodies.__getitem__,
        name=f"people[draw={draw}]",
        title=f"people, draw {draw} (stand-in for SHREC'14 synthetic)",
        stand_in_for="shrec14-synthetic",
        half_width=_HALF_WIDTH,
    )


def many_people(n: int) -> ShapeSet:
    """Return a data set of bodies that are drawn at random, in 20 poses each.

    Parameters
    ----------
    n
        Number of bodies.

    Raises
    ------
    ConfigurationError
        If the number of bodies is too small or too large.
    """
    if not _FEWEST <= n <= _MOST:
        problem = f"people[n={n}] has no such number of bodies"
        raise ConfigurationError(problem, f"choose {_FEWEST} to {_MOST}")
    return _bodies(
        [f"body-{number}" for number in range(n)],
        _body,
        name=f"people[n={n}]",
        title=f"{n} people drawn at random",
        half_width=_HALF_WIDTH_OF_MANY,
    )


@functools.lru_cache(maxsize=_MOST)
def _body(name: str) -> Subject:
    """Return a body of ``people[n=N]``, such as ``body-0``."""
    number = int(name.removeprefix("body-"))
    return new_subject(np.random.default_rng([_SEED, number]), number % 3)


def _bodies(subjects: list[str], body: Callable[[str], Subject], **facts: Any) -> ShapeSet:
    """Return bodies in all poses, with facts about their set."""
    return ShapeSet(
        shapes=_entries(subjects, POSES),
        load=lambda entry: body_mesh(body(entry.subject), POSES[entry.pose]),
        key=lambda entry: describe_body(body(entry.subject), POSES[entry.pose]),
        code=lambda _: ("benchmark.datasets.bodies",),
        **facts,
    )


def _entries(subjects: Iterable[str], poses: Iterable[str]) -> tuple[Entry, ...]:
    """Return the shapes of subjects in poses."""
    pairs = itertools.product(subjects, poses)
    return tuple(Entry(f"{subject}_{pose}", subject, pose) for subject, pose in pairs)


def humans_scanlike() -> ShapeSet:
    """Return the stand-in for SHREC'14 real: simulated scans of 40 adults in 10 poses each.

    As in the official set, and unlike in its synthetic companion, all bodies are adults of similar
    build, nobody is symmetric or takes a pose exactly, fingers and toes are fused, and each scan
    has its own triangles.
    """
    adults = SUBJECTS["humans-scanlike"]

    def key(entry: Entry) -> str:
        """Return a text that determines a scan: its name (the seed), the body and the cavities."""
        body = describe_body(adults[entry.subject], _angles(entry))
        return f"scan of {entry.identifier}: {body} {file_digest(CAVITIES)}"

    return ShapeSet(
        name="humans-scanlike",
        title="humans, scan-like (stand-in for SHREC'14 real)",
        shapes=_entries(adults, _SCANNED_POSES),
        load=_scan,
        key=key,
        half_width=_HALF_WIDTH_OF_SCANS,
        stand_in_for="shrec14-real",
        code=lambda _: ("benchmark.datasets.bodies", "benchmark.datasets.scanning"),
    )


@functools.lru_cache(maxsize=1)  # it takes seconds, and cameras around a shape ask for it again
def _scan(entry: Entry) -> Mesh:
    """Return the mesh of a scanned person."""
    from benchmark.datasets.scanning import scanned  # imports numba

    body = body_mesh(SUBJECTS["humans-scanlike"][entry.subject], _angles(entry))
    return scanned(body, entry.subject, entry.identifier)


def _angles(entry: Entry) -> FloatArray:
    """Return the joint angles of a scanned person, near those of the pose."""
    return jittered(POSES[entry.pose], _POSE_DEVIATION, named_random(entry.identifier, "pose"))


@functools.cache
def _phenotypes(dataset: str) -> FloatArray:
    """Return the phenotypes of the subjects of a set, of one draw or over all draws."""
    if dataset == JUDGES:
        return np.array([astuple(_body(f"body-{number}")) for number in range(N_JUDGES)])
    bodies: list[Subject] = []
    for name, subjects in SUBJECTS.items():
        if dataset in (name, name.partition("[")[0]):
            bodies += subjects.values()
    return np.array([astuple(body) for body in bodies])


def clearances(bodies: Iterable[Subject], sets: Iterable[str] = TESTED) -> dict[str, float]:
    """Return the minimum distance of some bodies to other subjects of each set, truncated to 1e-4.

    Parameters
    ----------
    bodies
        The bodies.
    sets
        Names of the sets.
    """
    points = np.array([astuple(body) for body in bodies])
    clearance_of = {}
    for name in sets:
        distances = np.linalg.norm(points[:, np.newaxis] - _phenotypes(name), axis=2)
        # A subject that is one of the bodies is at distance 0 of it.
        nearest = distances[:, distances.min(axis=0) > 0].min()
        clearance_of[name] = float(np.floor(1e4 * nearest) / 1e4)
    return clearance_of


def new_subject(random: np.random.Generator, kind: int, away_from: Iterable[str] = ()) -> Subject:
    """Draw a body at a distance of at least :data:`CLEARANCE` from the subjects of all sets.

    Age and shape are uniform, as is the gender of a child.

    Parameters
    ----------
    random
        Random generator.
    kind
        0 for a man, 1 for a woman, 2 for a child.
    away_from
        Further sets whose subjects are avoided, such as :data:`JUDGES`.
    """
    is_child = kind == 2
    sets = (*TESTED, "animals", *away_from)
    avoided = np.concatenate([_phenotypes(name) for name in sets])
    while True:
        gender = random.uniform() if is_child else float(kind)
        age = random.uniform(*(_CHILDREN if is_child else _ADULTS))
        candidate = Subject(gender, age, *random.uniform(_LOWEST, _HIGHEST).tolist())
        if np.linalg.norm(avoided - astuple(candidate), axis=1).min() >= CLEARANCE:
            return candidate
