"""A trained template, from its files to forms."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch

from benchmark.api.learning import card_digest, read_card
from benchmark.geometry.mesh import Mesh, Points
from learned.described import described_in
from learned.frame import frame_of, of_unit_area
from learned.template.configuration import Template, from_card
from learned.template.distances import rays_around
from learned.template.network import TemplateNetwork
from learned.template.search import ROUNDS, Found, search
from learned.weights import with_weights

RAYS = max(each.rays for each in ROUNDS)
"""Rays around a shape whose code is searched."""

_TOGETHER = 16384
"""Vertices that are deformed together, lest a mesh of a million fill the memory."""


def configuration_of(card: Mapping[str, Any], folder: Path) -> Template:
    """Configuration that a card names.

    Raises
    ------
    ConfigurationError
        If it is the card of another kind of model.
    """
    return from_card(described_in(card, "template", folder, "a template"))


def load_template(folder: Path) -> tuple[TemplateNetwork, Template]:
    """Fields with the weights in a folder, in float64 and fixed, and their configuration.

    Raises
    ------
    ConfigurationError
        If the weights are not those that the card describes, or belong to another configuration.
    """
    return _load(folder, card_digest(read_card(folder)))


@functools.lru_cache(maxsize=4)
def _load(folder: Path, _digest: str) -> tuple[TemplateNetwork, Template]:
    configuration = configuration_of(read_card(folder), folder)
    network = with_weights(TemplateNetwork(configuration), folder, configuration.name)
    return network.double().requires_grad_(False), configuration


def deformed(network: TemplateNetwork, configuration: Template, mesh: Mesh) -> tuple[Points, dict[str, float | str]]:
    """Return where the vertices of a surface lie in the space of the template, shape (n, 3), and facts about it.

    Parameters
    ----------
    network, configuration
        As from :func:`load_template`.
    mesh
        Any surface, in any place.

    Raises
    ------
    UnsupportedShape
        If there is no surface, it encloses nothing, or the deformation leaves no surface.
    """
    standing = frame_of(mesh).seen(mesh)
    found = search(network, rays_around(standing, RAYS), configuration.code, ROUNDS)
    places, correction = _moved(network, standing.vertices, found)
    notes: dict[str, float | str] = {
        "distance_error": float(found.errors[0]),
        "correction": correction,
        "code_norm": float(found.codes[0].norm()),
        "steps": float(sum(each.steps for each in ROUNDS)),
    }
    return of_unit_area(mesh, places), notes


@torch.no_grad()
def _moved(network: TemplateNetwork, vertices: Points, found: Found) -> tuple[Points, float]:
    """Vertices in the space of the template, and the mean absolute correction of the distance at them."""
    points = torch.from_numpy(np.array(vertices)) @ found.turns[0].T
    moved = [network.deformed(part[None], found.codes) for part in points.split(_TOGETHER)]
    places = torch.cat([each[0][0, :, 0] for each in moved])
    corrections = torch.cat([each[1][0, :, 0, 0] for each in moved])
    return places.numpy(), float(corrections.abs().mean())
