"""A shape under every perturbation at every strength, as a data set for figures."""

from __future__ import annotations

from dataclasses import dataclass

from benchmark.datasets.base import Dataset, Entry
from benchmark.datasets.perturbations.dataset import PERTURBATIONS, STRENGTHS, Perturbed, perturbed
from benchmark.errors import DatasetError
from benchmark.geometry.camera import Camera, DepthSensor
from benchmark.geometry.mesh import Mesh

__all__ = ["Overview", "overview"]


@dataclass(frozen=True)
class Overview:
    """Data set with a class for each perturbation and a pose for each strength.

    Parameters
    ----------
    clean
        The data set of the shape.
    shape
        The shape to perturb.
    """

    clean: Dataset
    shape: Entry
    stand_in_for: str = ""

    @property
    def name(self) -> str:
        """Name of the output file."""
        return f"{self.clean.name}-perturbations"

    @property
    def title(self) -> str:
        """Name in captions."""
        return f"{self.shape.identifier} of {self.clean.title} under each perturbation"

    @property
    def half_width(self) -> float | None:
        """Half the width of the camera's frame, as in the clean set."""
        return self.clean.half_width

    @property
    def entries(self) -> tuple[Entry, ...]:
        """Entries for each perturbation and strength."""
        return tuple(
            Entry(f"{perturbation}={strength}", perturbation, f"strength {strength}")
            for perturbation in PERTURBATIONS
            for strength in STRENGTHS
        )

    def load(self, entry: Entry) -> Mesh:
        """Perturb the shape."""
        return self._set_of(entry).load(self.shape)

    def recipe(self, entry: Entry) -> str:
        """Return the recipe of the perturbed mesh."""
        return self._set_of(entry).recipe(self.shape)

    def camera(self, entry: Entry) -> Camera:
        """Return the camera of the shape under the perturbation."""
        return self._set_of(entry).camera(self.shape)

    def sensor(self, entry: Entry) -> DepthSensor | None:
        """Return the depth sensor under the perturbation; None for an ideal camera."""
        return self._set_of(entry).sensor(self.shape)

    def _set_of(self, entry: Entry) -> Perturbed:
        perturbation, _, strength = entry.identifier.partition("=")
        return perturbed(self.clean, perturbation, int(strength))


def overview(dataset: Dataset, identifier: str = "") -> Overview:
    """Return a shape of a data set under every perturbation; by default the first shape.

    Raises
    ------
    DatasetError
        If the shape does not exist.
    """
    entries = [entry for entry in dataset.entries if identifier in ("", entry.identifier)]
    if not entries:
        raise DatasetError(f"data set '{dataset.name}' has no shape '{identifier}'", "see 'data list'")
    return Overview(dataset, entries[0])
