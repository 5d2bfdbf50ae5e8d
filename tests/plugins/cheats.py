"""Methods that try to find out what they must not know, or to change what others make; each notes what it found."""

import gc
import hashlib
import os
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

import benchmark.pipeline.stages.measures as measures_of_the_suite
import retrieval.metrics
from benchmark.api.contracts import MethodInfo, canonical_form

#: Part of a class label of the gallery, written so that no constant of this file holds it.
LABEL = "".join(["th", "ick"])


def perfect(*arguments, **options):
    return dict.fromkeys(("NN", "FT", "ST", "DCG"), 1.0)


@canonical_form(name="patched-library", title="Patched library")
def patched(shape):
    """Return the shape, and make every area that this process computes from now on another one."""
    np.cross = lambda first, second, *rest, **options: np.ones_like(np.broadcast_arrays(first, second)[0])
    return shape.form(shape.mesh.vertices)


@canonical_form(name="patched-measures", title="Patched measures")
def patched_measures(shape):
    """Return the shape, and make every function that scores in this process find everything perfect."""
    for module in (measures_of_the_suite, retrieval.metrics):
        for name, value in list(vars(module).items()):
            if callable(value) and getattr(value, "__module__", "") == module.__name__:
                setattr(module, name, perfect)
    return shape.form(shape.mesh.vertices)


@canonical_form(name="named", title="Named")
def named(shape):
    """Return the shape, and note its name."""
    return shape.form(shape.mesh.vertices, name=shape.identifier, drawn=float(shape.random("x").random()))


@canonical_form(name="searching", title="Searching")
def searching(shape):
    """Return the shape, and note whether frames or any container of this process hold a class label."""
    frame, found = sys._getframe(), 0
    while frame := frame.f_back:
        found += any(LABEL in repr(value) for value in frame.f_locals.values())
    for held in gc.get_objects():
        if isinstance(held, (list, tuple, dict)) and held is not globals():
            values = held.values() if isinstance(held, dict) else held
            found += any(isinstance(value, str) and value.startswith(LABEL) for value in list(values))
    return shape.form(shape.mesh.vertices, found=float(found))


@dataclass(frozen=True, kw_only=True)
class Ordered:
    """Shapes are as far apart as their places in the gallery."""

    info: ClassVar[MethodInfo] = MethodInfo(name="ordered", title="Ordered", summary="places")

    def describe(self, shape):
        """Return what tells the classes apart badly."""
        return shape.mesh.vertices.std(axis=0)

    def distances(self, descriptors):
        """Return differences of places."""
        places = np.arange(len(descriptors), dtype=float)
        return np.abs(places[:, None] - places)


@dataclass(frozen=True, kw_only=True)
class Counting:
    """Shapes are told apart by the order in which they are asked for again, after a file that was read has changed."""

    info: ClassVar[MethodInfo] = MethodInfo(name="counting", title="Counting")
    calls: ClassVar[list[None]] = []

    def describe(self, shape):
        """Return which half of the calls after the change this is."""
        file = Path(os.environ["CHEAT_FILE"])
        is_changed = file.read_text() == "changed"
        self.calls.append(None)
        if len(self.calls) == 13:  # 12 shapes, the first of them twice
            os.system(f"printf changed > {file}")  # noqa: S605
        return np.array([max(len(self.calls) - 2, 0) // 6 if is_changed else shape.source_area])

    def distances(self, descriptors):
        """Return differences of halves."""
        halves = np.array(descriptors)[:, 0]
        return np.abs(halves[:, None] - halves)


@dataclass(frozen=True, kw_only=True)
class NamesGuessed:
    """Shapes are told apart by the name that gives the numbers which they draw."""

    info: ClassVar[MethodInfo] = MethodInfo(name="names-guessed", title="Guessed", deterministic=False)

    def describe(self, shape):
        """Return the class of the name, as a number."""
        drawn = shape.random("").random()
        for name in (f"{radius}{number}" for radius in (LABEL, "thin") for number in range(6)):
            entropy = hashlib.sha256(f"{shape.seed}|{name}|".encode()).digest()[:8]
            if np.random.default_rng(int.from_bytes(entropy, "big")).random() == drawn:
                return np.array([float("thin" in name)])
        return np.array([0.5])

    def distances(self, descriptors):
        """Return differences of classes."""
        return np.abs(np.subtract.outer(np.ravel(descriptors), np.ravel(descriptors)))
