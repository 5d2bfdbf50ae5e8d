"""A trained field: loading, prediction and forms."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from benchmark.api.contracts import FloatArray, Shape
from benchmark.api.learning import card_digest, read_card
from benchmark.errors import UnsupportedShape
from benchmark.geometry.interpolation import vertex_normals
from benchmark.geometry.mesh import Mesh, Points, edges_of
from learned.described import described_in
from learned.field.configuration import Field, from_card
from learned.field.detail import Rest, with_detail
from learned.field.network import FieldNetwork, build_field
from learned.field.sampling import even_samples
from learned.frame import frame_of, of_unit_area
from learned.weights import with_weights

MOST_VERTICES = 50_000
"""Largest number of vertices; meshes prepared for a comparison have 2000."""

INSIDE_OUT = 1e-9
"""Size of a negative volume, in units of sqrt(area)^3, above which a surface faces inward; a flat one has no volume."""

_AT_ONCE = 4096
"""Positions that are decoded together, which bounds the memory for large meshes."""


def configuration_of(card: Mapping[str, Any], folder: Path) -> Field:
    """Return the configuration on a card.

    Raises
    ------
    ConfigurationError
        If the card belongs to another kind of model.
    """
    return from_card(described_in(card, "field", folder, "a deformation field"))


def load_field(folder: Path) -> FieldNetwork:
    """Load the network in a folder, ready to predict.

    Raises
    ------
    ConfigurationError
        If the weights do not match the card, or belong to another configuration.
    """
    return _load(folder, card_digest(read_card(folder)))


@functools.lru_cache(maxsize=4)
def _load(folder: Path, _digest: str) -> FieldNetwork:
    configuration = configuration_of(read_card(folder), folder)
    return with_weights(build_field(configuration), folder, configuration.name)


@torch.inference_mode()
def predicted(network: FieldNetwork, mesh: Mesh) -> tuple[Points, FloatArray]:
    """Predict canonical positions of vertices, shape (n, 3), and rotations to the canonical pose, shape (n, 3, 3).

    Parameters
    ----------
    network
        The field.
    mesh
        A surface in its own frame.
    """

    def row(array: FloatArray) -> Tensor:
        return torch.from_numpy(np.array(array, dtype=np.float64))[None]

    samples = even_samples(mesh, network.n_points)
    tokens = network.encoded(row(samples.points), row(samples.normals))
    normals = vertex_normals(mesh)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True).clip(min=np.finfo(float).tiny)
    positions, rotations = [], []
    for first in range(0, mesh.n_vertices, _AT_ONCE):
        some = slice(first, first + _AT_ONCE)
        unbent = network.decoded(tokens, row(mesh.vertices[some]), row(normals[some]))
        positions.append(unbent.positions[0].numpy())
        rotations.append(unbent.rotations[0].numpy())
    return np.concatenate(positions), np.concatenate(rotations)


def form_of(network: FieldNetwork, shape: Shape, reach: float, rounds: int) -> tuple[Points, dict[str, float | str]]:
    """Return the vertices of the form, of unit area, shape (n, 3), and notes about it.

    Parameters
    ----------
    network
        The field.
    shape
        The input.
    reach, rounds
        See :func:`learned.field.detail.with_detail`.

    Raises
    ------
    UnsupportedShape
        If the surface has no area or too many vertices, or its form has no area.
    """
    mesh = shape.mesh
    if mesh.n_vertices > MOST_VERTICES:
        raise UnsupportedShape(
            f"a deformation field of {mesh.n_vertices} vertices takes too long", f"keep at most {MOST_VERTICES}"
        )
    inside = frame_of(mesh).seen(mesh)
    positions, rotations = predicted(network, _outward(inside))
    rest = Rest.of(inside.vertices, shape.laplacian())
    vertices = of_unit_area(mesh, with_detail(rest, positions, rotations, reach, rounds))
    before, after = (_edge_lengths(points, mesh) for points in (inside.vertices, vertices))
    moved = np.linalg.norm(vertices - positions, axis=1)
    notes: dict[str, float | str] = {
        "edge_strain": float(np.abs(after - before).sum() / before.sum()),
        "mean_correction": float(moved.mean()),
    }
    return vertices, notes


def _outward(mesh: Mesh) -> Mesh:
    """Return the surface with its triangles flipped if its volume is negative: bodies face outward."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    volume = float(np.einsum("mk,mk->", a, np.cross(b, c)) / 6)
    return Mesh(mesh.vertices, mesh.faces[:, ::-1]) if volume < -INSIDE_OUT else mesh


def _edge_lengths(vertices: Points, mesh: Mesh) -> FloatArray:
    starts, ends = edges_of(mesh.faces).ends.T
    return np.asarray(np.linalg.norm(vertices[starts] - vertices[ends], axis=1))
