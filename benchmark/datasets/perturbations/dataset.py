"""Data sets with a perturbation of a given strength: ``animals-few[noise=3]``."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from benchmark.api.contracts import Input
from benchmark.datasets.base import Dataset, Entry, Part
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
    """A type of perturbation.

    Parameters
    ----------
    title
        Name in captions.
    unit
        Meaning of the amounts.
    amounts
        Amount at each strength.
    on_mesh
        Function that perturbs the mesh; None for perturbations of the camera.
    inputs
        Inputs that the perturbation applies to.
    """

    title: str
    unit: str
    amounts: tuple[float, ...]
    on_mesh: Callable[[Mesh, float, np.random.Generator], Mesh] | None = None
    inputs: tuple[Input, ...] = ("mesh",)


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
    "view-angle": Perturbation("view angle", "largest angle in degrees", (10, 20, 30, 45, 60), inputs=("view",)),
    "depth-noise": Perturbation(
        "depth noise and steps", "deviation and step / depth of the frame", (0.0005, 0.001, 0.002, 0.004, 0.008),
        inputs=("view",),
    ),
}  # fmt: skip

_NAME = re.compile(r"(?P<base>.+)\[(?P<perturbation>[a-z-]+)=(?P<strength>[1-5])\]", re.DOTALL)


def perturbed_name(base: str, perturbation: str, strength: int) -> str:
    """Return the name of a data set under a perturbation."""
    return f"{base}[{perturbation}={strength}]"


def parsed(name: str) -> tuple[str, str, int] | None:
    """Return the data set, perturbation and strength in a name; None if it is not the name of a perturbed set."""
    match = _NAME.fullmatch(name)
    if not match or match["perturbation"] not in PERTURBATIONS:
        return None
    return match["base"], match["perturbation"], int(match["strength"])


@dataclass(frozen=True)
class Some:
    """A subset of a data set with a separate name.

    Parameters
    ----------
    whole
        The data set.
    part
        The selected shapes.
    name, title
        Name and title of the subset.
    """

    whole: Dataset
    part: Part
    name: str
    title: str

    @property
    def stand_in_for(self) -> str:
        """Always empty."""
        return ""

    @property
    def half_width(self) -> float | None:
        """Half the width of the camera's frame, as in the whole set."""
        return self.whole.half_width

    @cached_property
    def entries(self) -> tuple[Entry, ...]:
        """Selected shapes, in the order of the data set."""
        return self.part.of(self.whole)

    def load(self, entry: Entry) -> Mesh:
        """Return the unprocessed mesh."""
        return self.whole.load(entry)

    def recipe(self, entry: Entry) -> str:
        """Return the recipe in the whole set."""
        return self.whole.recipe(entry)

    def camera(self, entry: Entry) -> Camera:
        """Return the depth camera for this shape."""
        return self.whole.camera(entry)


@dataclass(frozen=True)
class Perturbed(ChangedDataset):
    """A data set with perturbed shapes.

    Parameters
    ----------
    perturbation
        A key of :data:`PERTURBATIONS`.
    strength
        Strength from 1 (weakest) to 5.
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
            If no usable mesh remains after the perturbation; the shape then counts as unsupported.
        """
        on_mesh = PERTURBATIONS[self.perturbation].on_mesh
        return mesh if on_mesh is None else on_mesh(mesh, self.amount, np.random.default_rng(self._seed(entry)))

    def recipe(self, entry: Entry) -> str:
        """Return the recipe of the clean mesh, the perturbation, the amount and the seed."""
        return f"{self._clean_recipe(entry)} {self.perturbation} {self.amount!r} {self._seed(entry)}"

    def camera(self, entry: Entry) -> Camera:
        """Return the camera of the clean set, for ``view-angle`` rotated about the vertical by up to +- the amount."""
        camera = super().camera(entry)
        if self.perturbation != "view-angle":
            return camera
        angle = np.radians(self.amount) * np.random.default_rng(self._seed(entry)).uniform(-1, 1)
        turned = Rotation.from_rotvec(angle * np.asarray(camera.up)).apply(camera.direction)
        return Camera(tuple(turned.tolist()), camera.up)

    def sensor(self, entry: Entry) -> DepthSensor | None:
        """Return the depth sensor; None for an ideal camera."""
        if self.perturbation == "depth-noise":
            return DepthSensor(self.amount, self.amount, self._seed(entry))
        return super().sensor(entry)

    def _seed(self, entry: Entry) -> int:
        """Return a seed that is the same at every strength, so that strengths differ only in the amount."""
        name = f"{self.perturbation}|{entry.identifier}".encode("utf-8", "surrogatepass")
        return int.from_bytes(hashlib.sha256(name).digest()[:4], "big")


def perturbed(clean: Dataset, perturbation: str, strength: int) -> Perturbed:
    """Perturb a data set.

    Raises
    ------
    ConfigurationError
        If the camera already has depth noise.
    """
    sensor = getattr(clean, "sensor", None)
    if perturbation == "depth-noise" and sensor and sensor(clean.entries[0]):
        raise ConfigurationError(f"{clean.name} has depth noise already", "name one strength of depth-noise")
    return Perturbed(clean, perturbation, strength)
