"""A trained model: loading, prediction, and the surface of the canonical pose."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from benchmark.api.learning import card_digest, read_card
from benchmark.geometry.depth import DepthImage
from benchmark.geometry.mesh import Mesh
from learned.images import enlarge, smooth, surface_behind
from learned.paired.card import network_of
from learned.paired.network import build
from learned.paired.pairs import seen_by
from learned.weights import with_weights


def load_model(folder: Path) -> tuple[nn.Module, dict[str, Any]]:
    """Load the network in a folder, ready to predict, and its card.

    Raises
    ------
    ConfigurationError
        If the weights do not match the card, or belong to another configuration.
    """
    return _load(folder, card_digest(read_card(folder)))


@functools.lru_cache(maxsize=16)
def _load(folder: Path, _digest: str) -> tuple[nn.Module, dict[str, Any]]:
    card = read_card(folder)
    configuration = network_of(card, folder).configuration
    return with_weights(build(configuration), folder, configuration.name), card


@torch.inference_mode()
def predict(network: nn.Module, image: Tensor) -> Tensor:
    """Predict depth and mask, shape (2, r, r), from one depth image, shape (1, r, r)."""
    image = image.to(next(network.parameters()).dtype)
    prediction: Tensor = network(image[None].contiguous(memory_format=torch.channels_last))[0]
    return prediction


def canonical_depth(folder: Path, depth: DepthImage, smoothing: float = 0.0) -> DepthImage:
    """Predict the depth image of the canonical pose.

    Parameters
    ----------
    folder
        Folder of the model.
    depth
        Depth image, shape (500, 500).
    smoothing
        Standard deviation, in pixels of the network, of the Gaussian that smooths the depth inside the mask.

    Returns
    -------
    numpy.ndarray
        Shape (500, 500), float32, 0 where the predicted mask is at most a half.

    Raises
    ------
    InvalidMesh, UnsupportedShape
        If the image does not fit, or is empty.
    ConfigurationError
        If the model does not match its card.
    """
    return enlarge(smooth(prediction(folder, depth), smoothing))


def prediction(folder: Path, depth: DepthImage) -> Tensor:
    """Predict depth and mask, shape (2, r, r), from a depth image; see :func:`canonical_depth`."""
    network, card = load_model(folder)
    crop = network_of(card, folder).configuration.crop
    image = seen_by(depth, int(card["schedule"]["resolution"]), crop)[:1]
    return predict(network, torch.from_numpy(image))


def canonical_surface(
    folder: Path, depth: DepthImage, smoothing: float = 0.0, jump: float | None = None
) -> tuple[Mesh, dict[str, float | str]]:
    """Return the surface of unit area behind the predicted image, and notes about it.

    Parameters
    ----------
    folder, depth, smoothing
        See :func:`canonical_depth`.
    jump
        Largest depth difference along an edge, as in :func:`surface_behind`.

    Raises
    ------
    UnsupportedShape
        If the network predicts an empty mask.
    """
    return surface_behind(canonical_depth(folder, depth, smoothing), jump)
