"""Weights of a network: to a file in half precision, and back into a network that is ready to predict."""

from __future__ import annotations

from pathlib import Path
from typing import TypeVar

import torch
from safetensors import SafetensorError
from safetensors.torch import load, save
from torch import nn

from benchmark.api.learning import checked_weights
from benchmark.errors import ConfigurationError

Network = TypeVar("Network", bound=nn.Module)


def as_stored(network: nn.Module) -> None:
    """Round the weights to half precision, which halves the file: what is tested is then what is on disk."""
    with torch.no_grad():
        for parameter in network.parameters():
            parameter.copy_(parameter.half().float())


def stored(network: nn.Module) -> bytes:
    """Content of the file of weights."""
    halves = {name: tensor.detach().cpu().half().contiguous() for name, tensor in network.state_dict().items()}
    content: bytes = save(halves)
    return content


def with_weights(network: Network, folder: Path, name: str) -> Network:
    """Fill a network with the weights in a folder, in double precision.

    The last bits of sums in single precision depend on the processor, and would decide pixels of a mask.

    Parameters
    ----------
    network
        As built; it is changed.
    folder
        Folder of the model.
    name
        Name of its configuration, for messages.

    Returns
    -------
    Network
        The same network, channels last, in evaluation mode.

    Raises
    ------
    ConfigurationError
        If the weights are not those that the card describes, or belong to another configuration.
    """
    try:
        tensors = {key: tensor.double() for key, tensor in load(checked_weights(folder)).items()}
    except (KeyError, TypeError, SafetensorError) as error:
        raise ConfigurationError(f"the model in {folder} is damaged: {error}", "train it again") from error
    if {key: tensor.shape for key, tensor in tensors.items()} != {
        key: tensor.shape for key, tensor in network.state_dict().items()
    }:
        raise ConfigurationError(
            f"the weights in {folder} belong to another configuration than '{name}'", "train the model again"
        )
    network.to(dtype=torch.float64, memory_format=torch.channels_last)
    network.load_state_dict(tensors)
    network.eval()
    return network


def n_parameters(network: nn.Module) -> int:
    """Number of trainable numbers."""
    return sum(parameter.numel() for parameter in network.parameters())
