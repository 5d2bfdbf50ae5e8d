"""The committed inputs: small shapes, raw meshes, depth images, signatures and distances, and networks by a formula."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.api.contracts import Mesh, Shape
from benchmark.datasets.base import Entry
from benchmark.geometry.camera import FRONT, Camera

GOLDEN = Path(__file__).parents[2] / "tests" / "golden"
INPUTS = GOLDEN / "inputs"


@cache
def arrays(name: str) -> Mapping[str, NDArray[Any]]:
    """All arrays of one file of inputs."""
    with np.load(INPUTS / f"{name}.npz", allow_pickle=False) as archive:
        return dict(archive)


def mesh(file: str, name: str) -> Mesh:
    """A mesh; positions are stored as multiples of a unit."""
    stored = arrays(file)
    return Mesh(stored[f"{name}/vertices"] * float(stored[f"{name}/unit"]), stored[f"{name}/faces"].astype(np.int32))


def shape(name: str) -> Shape:
    """A prepared shape; of the tetrahedron nobody knows the area."""
    surface = mesh("shapes", name)
    return Shape(identifier=name, mesh=surface, source_area=None if name == "tetrahedron" else 3.0 * surface.n_vertices)


def depth_shape(name: str) -> Shape:
    """A shape with a depth image, for networks that look at nothing else."""
    depth = {"nothing": np.zeros((500, 500)), "tiny": np.zeros((32, 32))}.get(name)
    if depth is None:
        depth = arrays("depth")[name] / 4096
    return Shape(identifier=name, mesh=mesh("shapes", "small-open"), depth=depth.astype(np.float32))


class CommittedMeshes:
    """A data set of the raw meshes, to be changed."""

    name = "committed"
    title = "committed meshes"
    stand_in_for = ""
    half_width = 100.0
    entries = (Entry("dog", "dog", "3"), Entry("scan", "scan", "0"))

    def load(self, entry: Entry) -> Mesh:
        return mesh("raw", entry.identifier)

    def recipe(self, entry: Entry) -> str:
        return entry.identifier

    def camera(self, entry: Entry) -> Camera:
        return FRONT


def write_model(network: Any, card: Mapping[str, Any], folder: Path) -> None:
    """Write a network with weights by a formula: legacy numpy streams are frozen, so no file of weights is needed.

    Matrices get the variances of He et al. 2015, biases small numbers; what else is learned moves a little from where
    it begins, which is no random number. Depths lie around the middle of the frame.
    """
    import torch

    from learned.weights import stored

    with torch.no_grad():
        for place, (name, parameter) in enumerate(network.named_parameters()):
            drawn = np.random.RandomState(place).uniform(-1, 1, tuple(parameter.shape))
            uniform = torch.from_numpy(np.asarray(drawn, dtype=np.float32))
            last = "head" in name
            if name.endswith("bias"):
                parameter.copy_(0.1 * uniform)
                parameter[: 2 * len(parameter) // 3 if last else 0] += 0.5
            elif name.endswith("weight") and parameter.ndim > 1:
                parameter.copy_((0.3 if last else 1.0) * (6 / parameter[0].numel()) ** 0.5 * uniform)
            else:
                parameter.add_(0.05 * uniform)
    content = stored(network)
    folder.mkdir(parents=True)
    (folder / "weights.safetensors").write_bytes(content)
    facts = {"digest": hashlib.sha256(content).hexdigest(), "data": "golden", "subjects": ["a"], "identifiers": ["a"]}
    (folder / "card.json").write_text(json.dumps({**card, **facts}))
