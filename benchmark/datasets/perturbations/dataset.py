"""A data set with a perturbation of some strength: ``animals-few[noise=3]``."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from benchmark.api.contracts import Input
from benchmark.datasets.base import Dataset, Entry, Part
from benchmark.datasets.camera_frames import CameraFrames
from benchmark.datasets.changed import ChangedDataset
from benchmark.datasets.perturbations import surface
from benchmark.datasets.perturbations.shortcuts import shortcuts
from benchmark.errors import ConfigurationError
from benchmark.geometry.camera import Camera, DepthSensor
from benchmark.geometry.mesh import Mesh

__all__ = ["PERTURBATIONS", "STRENGTHS", "Perturbation", "Perturbed", "Some", "parsed", "perturbed", "perturbed_name"]

STRENGTHS = (1, 2, 3, 4, 5)


@dataclass(frozen=True)
class Perturbation:
    """One way to perturb shapes.

    Parameters
    ----------
    title
        In words.
    unit
        What the amounts are.
    amounts
        One for each strength.
    on_mesh
        Perturbs the mesh; None where the camera is what is perturbed.
    inputs
        Inputs that it is made for.
    of_frames
        Parameter of a set of depth frames that takes the amount; "" for what perturbs meshes or their camera.
    """

    title: str
    unit: str
    amounts: tuple[float, ...]
    on_mesh: Callable[[Mesh, float, np.random.Generator], Mesh] | None = None
    inputs: tuple[Input, ...] = ("mesh",)
    of_frames: str = ""


PERTURBATIONS: dict[str, Perturbation] = {
    "noise": Perturbation(
        "vertex noise", "standard deviation / extent", (0.001, 0.002, 0.004, 0.008, 0.016), surface.noise
    ),
    "holes": Perturbation("holes", "number of holes", (2, 5, 10, 20, 40), surface.holes),
    "shortcuts": Perturbation("topological shortcuts", "number of glued pairs", (1, 2, 3, 4, 5), shortcuts),
    "resolution": Perturbation("resolution", "vertices", (20000, 8000, 1500, 1000, 500), surface.resolution),
    "remeshing": Perturbation(
        "other re-meshing", "length of an edge / extent", (0.006, 0.009, 0.013, 0.018, 0.024), surface.remeshing
    ),
    "missing-parts": Perturbation(
        "missing parts", "share of the area", (0.05, 0.1, 0.2, 0.3, 0.4), surface.missing_parts
    ),
    "scale": Perturbation("scale", "largest factor", (1.1, 1.25, 1.5, 2.0, 4.0), surface.scale),
    "view-angle": Perturbation("view angle", "largest angle in degrees", (10, 20, 30, 45, 60), inputs=("view",)),
    "depth-noise": Perturbation(
        "depth noise and steps", "deviation and step / depth of the frame", (0.0005, 0.001, 0.002, 0.004, 0.008),
        inputs=("view",),
    ),
    "distance": Perturbation(
        "distance of the camera", "metres", (2, 3, 4, 5, 6), inputs=("view",), of_frames="distance"
    ),
    "frame-noise": Perturbation(
        "noise and steps of the camera", "times its own", (2, 4, 8, 16, 32), inputs=("view",), of_frames="noise"
    ),
    "missing-pixels": Perturbation(
        "missing pixels", "share of the pixels", (0.05, 0.1, 0.2, 0.4, 0.6), inputs=("view",), of_frames="missing"
    ),
    "wrong-mask": Perturbation(
        "wrong mask", "wrong pixels / pixels of the object", (0.05, 0.1, 0.15, 0.2, 0.3),
        inputs=("view",), of_frames="wrong_mask",
    ),
    "occlusion": Perturbation(
        "a box before the object", "share of the object", (0.1, 0.2, 0.3, 0.4, 0.5),
        inputs=("view",), of_frames="hidden",
    ),
}  # fmt: skip

_NAME = re.compile(r"(?P<base>.+)\[(?P<perturbation>[a-z-]+)=(?P<strength>[1-5])\]", re.DOTALL)


def perturbed_name(base: str, perturbation: str, strength: int) -> str:
    """Name of a data set under a perturbation."""
    return f"{base}[{perturbation}={strength}]"


def parsed(name: str) -> tuple[str, str, int] | None:
    """Data set, perturbation and strength of a name; None where it names no perturbed set."""
    match = _NAME.fullmatch(name)
    if not match or match["perturbation"] not in PERTURBATIONS:
        return None
    return match["base"], match["perturbation"], int(match["strength"])


@dataclass(frozen=True)
class Some:
    """Some shapes of a data set under a name of their own.

    Parameters
    ----------
    whole
        The data set.
    part
        Which of its shapes.
    name, title
        What they are called together.
    """

    whole: Dataset
    part: Part
    name: str
    title: str

    @property
    def stand_in_for(self) -> str:
        """Nothing: it is a set of its own."""
        return ""

    @property
    def half_width(self) -> float | None:
        """Half the width of the camera's frame, that of the whole set."""
        return self.whole.half_width

    @cached_property
    def entries(self) -> tuple[Entry, ...]:
        """The shapes, in the order of the data set."""
        return self.part.of(self.whole)

    def load(self, entry: Entry) -> Mesh:
        """Return the mesh as the set gives it."""
        return self.whole.load(entry)

    def recipe(self, entry: Entry) -> str:
        """Name what determines the mesh."""
        return self.whole.recipe(entry)

    def camera(self, entry: Entry) -> Camera:
        """Return the depth camera for this shape."""
        return self.whole.camera(entry)


@dataclass(frozen=True)
class Perturbed(ChangedDataset):
    """All shapes of a data set under one perturbation.

    Parameters
    ----------
    perturbation
        A key of :data:`PERTURBATIONS`.
    strength
        From 1, the weakest, to 5.
    """

    perturbation: str
    strength: int

    @property
    def name(self) -> str:
        """Name on the command line."""
        return perturbed_name(self.clean.name, self.perturbation, self.strength)

    @property
    def title(self) -> str:
        """Name in captions."""
        known = PERTURBATIONS[self.perturbation]
        return f"{self.clean.title}, {known.title}: {known.unit} {self.amount:g}"

    @property
    def amount(self) -> float:
        """Amount of the perturbation at this strength."""
        return PERTURBATIONS[self.perturbation].amounts[self.strength - 1]

    def changed(self, mesh: Mesh, entry: Entry) -> Mesh:
        """Perturb the mesh of the clean set.

        Raises
        ------
        UnsupportedShape
            If the perturbation leaves nothing that can be prepared; the shape then counts as unsupported.
        """
        on_mesh = PERTURBATIONS[self.perturbation].on_mesh
        return mesh if on_mesh is None else on_mesh(mesh, self.amount, np.random.default_rng(self._seed(entry)))

    def recipe(self, entry: Entry) -> str:
        """Name what determines the mesh."""
        return f"{self._clean_recipe(entry)} {self.perturbation} {self.amount!r} {self._seed(entry)}"

    def camera(self, entry: Entry) -> Camera:
        """Look as in the clean set, or from beside: turned about the vertical by up to the amount, either way."""
        camera = super().camera(entry)
        if self.perturbation != "view-angle":
            return camera
        angle = np.radians(self.amount) * np.random.default_rng(self._seed(entry)).uniform(-1, 1)
        turned = Rotation.from_rotvec(angle * np.asarray(camera.up)).apply(camera.direction)
        return Camera(tuple(turned.tolist()), camera.up)

    def sensor(self, entry: Entry) -> DepthSensor | None:
        """Return what the depth camera adds to its image; None for a camera without faults."""
        if self.perturbation == "depth-noise":
            return DepthSensor(self.amount, self.amount, self._seed(entry))
        return super().sensor(entry)

    def _seed(self, entry: Entry) -> int:
        """The same at every strength, so that a stronger perturbation is more of the same."""
        name = f"{self.perturbation}|{entry.identifier}".encode("utf-8", "surrogatepass")
        return int.from_bytes(hashlib.sha256(name).digest()[:4], "big")


def perturbed(clean: Dataset, perturbation: str, strength: int) -> Perturbed:
    """Put a data set under a perturbation, which of frames is a parameter of the set.

    Raises
    ------
    ConfigurationError
        If the perturbation is one of frames, and the set has none; or if the camera has depth noise already.
    """
    known = PERTURBATIONS[perturbation]
    if known.of_frames and isinstance(clean, CameraFrames):
        change: dict[str, Any] = {known.of_frames: known.amounts[strength - 1]}
        return Perturbed(replace(clean, **change), perturbation, strength)
    if known.of_frames:
        raise ConfigurationError(
            f"{clean.name} has no frames of a depth camera, which '{perturbation}' perturbs",
            "use it with camera or camera-few, or choose a perturbation of surfaces, such as noise",
        )
    sensor = getattr(clean, "sensor", None)
    if perturbation == "depth-noise" and sensor and sensor(clean.entries[0]):
        raise ConfigurationError(f"{clean.name} has depth noise already", "name one strength of depth-noise")
    return Perturbed(clean, perturbation, strength)
