"""Networks with one code: predicted images come from a few hundred numbers.

So no pixel of a pose leaks through.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional

from learned.paper_network import SLOPE, initialise

CODE_RESOLUTION = 128
"""Pixels per side of an image."""

_INNERMOST = 4
"""Pixels per side of the innermost features."""


class CodeNetwork(nn.Module):
    """Strided encoder to one code, and a decoder from that code alone, to depth and mask.

    Parameters
    ----------
    width
        Channels of the outermost block.
    code_size
        Length of the code.
    seed
        Seed of the random weights, which depend on nothing else.
    """

    def __init__(self, width: int = 16, code_size: int = 256, seed: int = 0) -> None:
        """Make the layers with random weights.

        The attributes name the tensors in files of weights, so that they must not change.

        Parameters
        ----------
        width
            Channels of the first layer; deeper ones have up to eight times as many.
        code_size
            Numbers of the code that stands for a whole image.
        seed
            Seed of the weights.
        """
        super().__init__()
        self.widths = [width, 2 * width, 4 * width, 8 * width, 8 * width]
        flat = self.widths[-1] * _INNERMOST**2
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            self.encoder = self._encoder()
            self.encode = nn.Linear(flat, code_size)
            self.decode = nn.Linear(code_size, flat)
            self.decoder = self._decoder()
            self.head = self._head()
            if isinstance(self.head, nn.Conv2d):
                initialise(self, self.head)

    def _encoder(self) -> nn.Sequential:
        """Return the blocks that each halve the size of an image."""

        def block(before: int, after: int) -> nn.Sequential:
            convolution = nn.Conv2d(before, after, 4, stride=2, padding=1)
            return nn.Sequential(convolution, nn.GroupNorm(8, after), nn.LeakyReLU(SLOPE))

        return nn.Sequential(*map(block, [1, *self.widths[:-1]], self.widths))

    def _decoder(self) -> nn.Sequential:
        """Return the blocks that each double the size of an image."""
        widths = [*self.widths[::-1], self.widths[0]]
        return _doublings(widths, lambda channels: nn.GroupNorm(8, channels))

    def _head(self) -> nn.Module:
        """Return what makes depths and the mask of the last features."""
        return nn.Conv2d(self.widths[0], 2, 3, padding=1)

    def forward(self, image: Tensor) -> Tensor:
        """Predict the canonical pose.

        Parameters
        ----------
        image
            Depth images, shape (n, 1, 128, 128), in [0, 1] with 0 as background.

        Returns
        -------
        torch.Tensor
            Depth of each side, about (0, 1), then the mask in (0, 1), shape (n, sides + 1, 128,
            128).
        """
        code = self.encode(self.encoder(image).flatten(1))
        innermost = functional.relu(self.decode(code)).unflatten(1, (-1, _INNERMOST, _INNERMOST))
        raw = self._finished(self.head(self.decoder(innermost)))
        return torch.cat([raw[:, :-1], torch.sigmoid(raw[:, -1:])], dim=1)

    def _finished(self, raw: Tensor) -> Tensor:
        """Return the output of the head as depths and the log-odds of the mask."""
        return raw


class PeopleNetwork(CodeNetwork):
    """The network of people of unknown size, which predicts the depth of front and back.

    It has residual blocks without normalisation. The last two doublings rearrange 16 channels into
    16 pixels, and the decoder adds to images of the average body.
    """

    def __init__(self, width: int = 16, code_size: int = 256) -> None:
        super().__init__(width, code_size)
        self.average = nn.Parameter(torch.zeros(3, CODE_RESOLUTION, CODE_RESOLUTION))

    def _encoder(self) -> nn.Sequential:
        """Return strided convolutions, with residual blocks behind the second and the third."""
        stages: list[nn.Module] = []
        inputs = [1, *self.widths[:-1]]
        for number, (before, after) in enumerate(zip(inputs, self.widths, strict=True)):
            convolution = StandardisedConv2d(before, after, 4, stride=2, padding=1)
            stages.append(nn.Sequential(convolution, nn.Identity(), nn.LeakyReLU(SLOPE)))
            if number in (1, 2):
                stages.append(ResidualBlock(after))
        return nn.Sequential(*stages)

    def _decoder(self) -> nn.Sequential:
        """Return doublings without normalisation, all but the last two."""
        return _doublings(self.widths[:0:-1], nn.Identity)

    def _head(self) -> nn.Module:
        """Return what makes two depths and the mask, four times as large as the features."""
        return nn.Sequential(nn.Conv2d(self.widths[1], 3 * 16, 3, padding=1), nn.PixelShuffle(4))

    def _finished(self, raw: Tensor) -> Tensor:
        """Return the output of the head, added to images of the average body."""
        return raw + 10 * self.average


def _doublings(widths: Sequence[int], norm: Callable[[int], nn.Module]) -> nn.Sequential:
    """Return blocks that double the size of an image, from each number of channels to the next."""
    blocks = []
    for before, after in pairwise(widths):
        deconvolution = nn.ConvTranspose2d(before, after, 4, stride=2, padding=1)
        blocks.append(nn.Sequential(deconvolution, norm(after), nn.ReLU()))
    return nn.Sequential(*blocks)


class StandardisedConv2d(nn.Conv2d):
    """Convolution whose weights have mean 0 and a fixed variance, times a learned gain.

    Both are those of each output channel.

    References
    ----------
    Brock, De and Smith, "Characterizing signal propagation to close the performance gap in
    unnormalized ResNets", ICLR 2021.
    """

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.gain = nn.Parameter(torch.ones(self.out_channels, 1, 1, 1))

    def forward(self, x: Tensor) -> Tensor:
        """Map features as :class:`torch.nn.Conv2d` does."""
        variance, mean = torch.var_mean(self.weight, dim=(1, 2, 3), keepdim=True)
        scale = (2 / (1 + SLOPE**2) / self.weight[0].numel()) ** 0.5
        weight = (self.weight - mean) * (torch.rsqrt(variance + 1e-8) * scale * self.gain)
        return self._conv_forward(x, weight, self.bias)


class ResidualBlock(nn.Module):
    """Two convolutions that keep the size, beside a skip connection."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.first = StandardisedConv2d(channels, channels, 3, padding=1)
        self.second = StandardisedConv2d(channels, channels, 3, padding=1)
        self.share = nn.Parameter(torch.full((), 0.1))

    def forward(self, x: Tensor) -> Tensor:
        """Map features, shape (n, channels, h, w), to the same shape."""
        inside = functional.leaky_relu(self.first(x), SLOPE)
        return functional.leaky_relu(x + self.share * self.second(inside), SLOPE)
