"""Committed inputs: small shapes, raw meshes, depth images, signatures and distances, and networks
by a formula.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from benchmark.api.contracts import Mesh, Shape
from benchmark.api.datasets import Entry, ShapeSet

#: Log-odds of masks by network: nearly all pixels are so far from 0.5 that rounding does not change
#: the mask.
MASKS = {
    "literal": 0.03,
    "without_weighting": 0.03,
    "size_free": 0.03,
    "without_srf": 0.09,
    "without_lrf": 0.15,
    "wide-extra": 0.45,
    "people": 0.54,
}

GOLDEN = Path(__file__).parent
INPUTS = GOLDEN / "inputs"


@cache
def arrays(name: str) -> Mapping[str, NDArray[Any]]:
    """Return all arrays of one file of inputs."""
    with np.load(INPUTS / f"{name}.npz", allow_pickle=False) as archive:
        return dict(archive)


def mesh(file: str, name: str) -> Mesh:
    """Return a mesh; positions are stored as multiples of a unit."""
    stored = arrays(file)
    return Mesh(
        stored[f"{name}/vertices"] * float(stored[f"{name}/unit"]),
        stored[f"{name}/faces"].astype(np.int32),
    )


def shape(name: str) -> Shape:
    """Return a prepared shape; the source area of the tetrahedron is unknown."""
    surface = mesh("shapes", name)
    return Shape(
        identifier=name,
        mesh=surface,
        source_area=None if name == "tetrahedron" else 3.0 * surface.n_vertices,
    )


def depth_shape(name: str) -> Shape:
    """Return a shape with a depth image, for networks that use nothing else."""
    refused = {"nothing": np.zeros((500, 500)), "tiny": np.zeros((32, 32))}
    depth = refused[name] if name in refused else arrays("depth")[name] / 4096
    return Shape(identifier=name, mesh=mesh("shapes", "small-open"), depth=depth.astype(np.float32))


def committed_meshes() -> Any:
    """Return a data set of raw meshes, to be changed."""
    return ShapeSet(
        name="committed",
        shapes=(Entry("dog", "dog", "3"), Entry("scan", "scan", "0")),
        load=lambda entry: mesh("raw", entry.identifier),
    )


def write_model(method: Any, folder: Path) -> None:
    """Write a model of a learner with weights by a formula: NumPy's legacy generator is frozen, so
    no file is needed.

    Matrices get the variances of He et al. 2015, biases small numbers; other parameters move
    slightly from their initial values, which are not random. Depths are around the middle of the
    frame."""
    import torch
    from safetensors.torch import save

    from learned.models import CONFIGURATIONS

    chosen = CONFIGURATIONS[method.configuration]
    network, configuration = chosen.build(), msgspec.to_builtins(chosen)
    with torch.no_grad():
        for place, (name, parameter) in enumerate(network.named_parameters()):
            drawn = np.random.RandomState(place).uniform(-1, 1, tuple(parameter.shape))
            uniform, last = torch.from_numpy(np.asarray(drawn, dtype=np.float32)), "head" in name
            if name.endswith("bias"):
                parameter.copy_(0.1 * uniform)
                if last:
                    depths = 2 * len(parameter) // 3
                    parameter[:depths] += 0.5
                    parameter[depths:] += MASKS.get(method.configuration, 0.0)
            elif name.endswith("weight") and parameter.ndim > 1:
                parameter.copy_(
                    (0.3 if last else 1.0) * (6 / parameter[0].numel()) ** 0.5 * uniform
                )
            else:
                parameter.add_(0.05 * uniform)
    content = save(
        {name: tensor.half().contiguous() for name, tensor in network.state_dict().items()}
    )
    folder.mkdir(parents=True)
    (folder / "weights.safetensors").write_bytes(content)
    facts = {
        "digest": hashlib.sha256(content).hexdigest(),
        "data": "people-fold-0",
        "subjects": ["a"],
        "identifiers": ["a"],
    }
    card = {"configuration": configuration, "schedule": {"resolution": 128}, **facts}
    (folder / "card.json").write_text(json.dumps(card))
