"""Models on disk: named networks, cards, and weights."""

from __future__ import annotations

import datetime
import functools
import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import msgspec
import torch
from safetensors import SafetensorError
from safetensors.torch import load as tensors_in
from safetensors.torch import save as bytes_of
from torch import Tensor, nn

from benchmark.api import learning
from benchmark.api.learning import CARD, WEIGHTS, TrainingData, checked_weights, read_card
from benchmark.errors import ConfigurationError
from benchmark.files import write_atomically
from benchmark.geometry.depth import DepthImage
from learned.code_network import CODE_RESOLUTION, CodeNetwork, PeopleNetwork
from learned.field_network import FieldNetwork
from learned.images import DepthScale, checked_image, resampled
from learned.paper_network import PaperNetwork

if TYPE_CHECKING:
    from learned.training import History, Schedule

HISTORY = "history.csv"

#: Beginnings of the names of weights of outputs that only losses used.
_TRAINING_ONLY = ("places.", "points.")

#: Rows of a convolution that are computed together: their patches of a feature image fit into the
#: cache.
_ROWS = 8

_Size = Annotated[int, msgspec.Meta(ge=1, le=4096)]


class Configuration(msgspec.Struct, frozen=True, kw_only=True):
    """A named network.

    Parameters
    ----------
    name
        Name on the command line.
    architecture
        ``"progressive"``: the paper's. ``"global-code"``: one code. ``"people"``: one code, front
        and back. ``"field"``: canonical positions of surface points.
    short_range, long_range, width
        See :class:`learned.paper_network.PaperNetwork`.
    crop
        Whether images and targets are cropped to the body, so that its size is unknown.
    """

    name: str
    architecture: Literal["progressive", "global-code", "people", "field"] = "progressive"
    short_range: bool = True
    long_range: bool = True
    width: _Size = 16
    crop: bool = False

    def build(self, seed: int = 0) -> nn.Module:
        """Return the network with random weights."""
        if self.architecture == "progressive":
            return PaperNetwork(self.width, self.short_range, self.long_range, seed)
        if self.architecture == "global-code":
            return CodeNetwork(self.width, seed=seed)
        return {"people": PeopleNetwork, "field": FieldNetwork}[self.architecture]()


_CONFIGURATIONS = (
    Configuration(name="literal"),
    Configuration(name="as_printed"),
    Configuration(name="without_srf", short_range=False),
    Configuration(name="without_lrf", long_range=False),
    Configuration(name="without_weighting"),
    Configuration(name="size_free", crop=True),
    Configuration(name="wide-extra", architecture="global-code"),
    Configuration(name="streamed-people", architecture="people", crop=True),
    Configuration(name="field-plain", architecture="field"),
)

CONFIGURATIONS: Mapping[str, Configuration] = {
    configuration.name: configuration for configuration in _CONFIGURATIONS
}
"""Networks by name."""


class _Scale(msgspec.Struct, frozen=True):
    """What a prediction needs of the schedule on a card."""

    resolution: _Size


class NetworkCard(learning.Card, frozen=True, kw_only=True):
    """Card of a network; the file has more facts for readers, such as losses and hardware."""

    configuration: Configuration
    schedule: _Scale | None = None
    """None for a network without images."""

    depth_scale: DepthScale = DepthScale()
    """Map of the depths that it predicts."""


def load_model(folder: Path) -> tuple[nn.Module, NetworkCard]:
    """Return the network in a folder, ready to predict in double precision, and its card.

    Raises
    ------
    ConfigurationError
        If the card or the weights are missing, damaged, or of different networks.
    """
    card = read_card(folder, NetworkCard)
    return _load(folder, card.configuration, card.digest), card


@functools.lru_cache(maxsize=16)
def _load(folder: Path, configuration: Configuration, _digest: str) -> nn.Module:
    """Load the network in a folder, ready to predict in double precision.

    The result is cached by the arguments.

    Parameters
    ----------
    folder
        Folder of the model.
    configuration
        The network that the folder should hold.
    _digest
        Digest of the weights. It is used by the cache alone, so that another model in the same
        folder is loaded anew.

    Raises
    ------
    ConfigurationError
        If the weights are damaged, not finite, or of another network.
    """
    # On this device tensors have shapes but no memory: a card that asks for a great network is
    # refused for its weights before anything of that size exists.
    with torch.device("meta"):
        network = configuration.build()
    try:
        tensors = {
            name: tensor.double()
            for name, tensor in tensors_in(checked_weights(folder)).items()
            if not name.startswith(_TRAINING_ONLY)
        }
        network.load_state_dict(tensors, assign=True)
    except (KeyError, TypeError, SafetensorError) as error:
        problem = f"the model in {folder} is damaged: {error}"
        raise ConfigurationError(problem, "train it again") from error
    except RuntimeError as error:
        problem = f"the weights in {folder} belong to another network than '{configuration.name}'"
        raise ConfigurationError(problem, "train it again") from error
    if not all(bool(tensor.isfinite().all()) for tensor in tensors.values()):
        problem = f"the model in {folder} is damaged: some of its weights are not finite"
        raise ConfigurationError(problem, "train it again")
    network = network.to(memory_format=torch.channels_last)
    for module in network.modules():
        if isinstance(module, nn.Conv2d) and module.stride == (1, 1):
            module._conv_forward = functools.partial(_in_stripes, module)
    return network.eval()


def _in_stripes(module: nn.Conv2d, x: Tensor, weight: Tensor, bias: Tensor | None) -> Tensor:
    """Convolve a few rows at a time, which takes torch half as long in double precision."""
    above, beside = module.padding
    dilation, _ = module.dilation
    x = nn.functional.pad(x, (beside, beside, above, above))
    reach = dilation * (weight.shape[-2] - 1)
    stripes = []
    for first in range(0, x.shape[-2] - reach, _ROWS):
        rows = x[:, :, first : first + _ROWS + reach]
        stripes.append(nn.functional.conv2d(rows, weight, bias, 1, 0, module.dilation))
    return torch.cat(stripes, dim=2)


@torch.inference_mode()
def predict(folder: Path, image: DepthImage) -> Tensor:
    """Predict the depth of each side and the mask with the network in a folder.

    Processors add in different orders. In double precision, that does not show in a form, which is
    stored in single precision; a prediction in single precision would differ, and with it the
    score.

    Parameters
    ----------
    folder
        Folder of the model.
    image
        Depth image, shape (500, 500).

    Returns
    -------
    torch.Tensor
        Depth of each side, and then the mask, shape (sides + 1, r, r).

    Raises
    ------
    InvalidMesh, UnsupportedShape
        See :func:`learned.images.checked_image`.
    """
    network, card = load_model(folder)
    resolution = card.schedule.resolution if card.schedule else CODE_RESOLUTION
    depth = resampled(checked_image(image), resolution, crop=card.configuration.crop)[:1]
    pixels = torch.from_numpy(depth)[None]
    pixels = pixels.to(dtype=torch.float64, memory_format=torch.channels_last)
    return card.depth_scale.undo(network(pixels)[0])


def average_body(folder: Path, resolution: int) -> Tensor:
    """Return the mean depth of the bodies that a model was trained on.

    Outside of all bodies, it is that of the nearest pixel.

    Raises
    ------
    ConfigurationError
        If the average body of its training is not known at this resolution.
    """
    training = read_card(folder, NetworkCard).data
    path = Path(__file__).with_name("models") / "average-bodies.safetensors"
    bodies = tensors_in(path.read_bytes())
    if training not in bodies or len(bodies[training]) != resolution:
        problem = f"training '{training}' has no average body of {resolution} x {resolution} pixels"
        raise ConfigurationError(
            problem, f"take a model of 128 x 128 pixels, of {', '.join(bodies)}"
        )
    return bodies[training].double() + 0.5


def save_model(
    network: nn.Module,
    configuration: Configuration,
    data: TrainingData,
    schedule: Schedule,
    history: History,
    folder: Path,
    facts: Mapping[str, Any],
) -> None:
    """Write a trained model: its weights in half precision, its losses and its card.

    The card is written last: a folder with a card holds a finished model.

    Parameters
    ----------
    network
        The network. Its weights are rounded to half precision in place, so that it equals the
        stored model.
    configuration
        Architecture and loss of the network.
    data
        Data on which it was trained.
    schedule
        Options of the training.
    history
        Losses of each epoch.
    folder
        Folder of the model.
    facts
        Further entries of the card.
    """
    import pandas  # lazy: predicting does not need it

    content = _in_half_precision(network)
    card = {
        "digest": hashlib.sha256(content).hexdigest(),
        "configuration": msgspec.to_builtins(configuration),
        "parameters": sum(parameter.numel() for parameter in network.parameters()),
        "data": data.name,
        "data_title": data.title,
        "pairs": data.n_pairs,
        "subjects": list(data.subjects),
        "identifiers": list(data.identifiers),
        "tested": data.tested,
        "clearance": dict(data.clearance),
        "schedule": asdict(schedule),
        "torch": str(torch.__version__),
        "commit": data.commit,
        "losses": history[-1],
        "finished": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        **facts,
    }
    _write(folder / WEIGHTS, content)
    losses = pandas.DataFrame(history).to_csv(index=False, float_format="%.6g", lineterminator="\n")
    _write(folder / HISTORY, losses.encode())
    _write(folder / CARD, _json_with_an_entry_a_line(card).encode())


def _in_half_precision(network: nn.Module) -> bytes:
    """Round the weights of a network to half precision, in place, and return those of its file."""
    with torch.no_grad():
        for parameter in network.parameters():
            parameter.copy_(parameter.half().float())
    halves = {
        name: tensor.detach().cpu().half().contiguous()
        for name, tensor in network.state_dict().items()
    }
    content: bytes = bytes_of(halves)
    return content


def _json_with_an_entry_a_line(entries: Mapping[str, Any]) -> str:
    """Return entries as JSON, which keeps each long list of shapes on one line."""
    lines = [f" {json.dumps(name)}: {json.dumps(value)}" for name, value in entries.items()]
    text = ",\n".join(lines)
    return f"{{\n{text}\n}}\n"


def _write(path: Path, content: bytes) -> None:
    """Write a file of a model, which survives a power failure."""
    write_atomically(path, lambda file: file.write(content), durable=True)
