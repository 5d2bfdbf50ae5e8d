"""Networks with one code: everything that is predicted comes from a few hundred numbers, and nothing of the pose leaks.

The blocks are those of :class:`learned.paired.network.GlobalCodeNetwork`; what differs is named by the configuration.
"""

from __future__ import annotations

from typing import cast

import torch
from torch import Tensor, nn
from torch.nn import functional

from learned.paired.network import GROUPS, MASK_LOGIT, SLOPE
from learned.streamed.configuration import Streamed, check_resolution

HALVINGS = 5
"""Blocks of the encoder and of the decoder."""

_SECOND_GAIN = 0.1
"""Scale of what a residual block adds at first, so that it begins as an enlargement."""


class ResidualBlock(nn.Module):
    """Doubles the size by interpolation and adds what two convolutions make of it; leaves no checkerboard.

    Parameters
    ----------
    before, after
        Channels that come in and go out.
    """

    def __init__(self, before: int, after: int) -> None:
        super().__init__()
        self.first = nn.Conv2d(before, after, 3, padding=1)
        self.first_norm = nn.GroupNorm(GROUPS, after)
        self.second = nn.Conv2d(after, after, 3, padding=1)
        self.second_norm = nn.GroupNorm(GROUPS, after)
        self.around = nn.Conv2d(before, after, 1) if before != after else nn.Identity()

    def forward(self, x: Tensor) -> Tensor:
        """Map features, shape (n, before, h, w), to shape (n, after, 2 h, 2 w)."""
        # A convolution of one pixel and an enlargement may change places, and the small image is cheaper.
        around = functional.interpolate(self.around(x), scale_factor=2, mode="bilinear", align_corners=False)
        inside = functional.interpolate(x, scale_factor=2, mode="nearest")
        inside = functional.leaky_relu(self.first_norm(self.first(inside)), SLOPE)
        return cast(Tensor, functional.leaky_relu(around + self.second_norm(self.second(inside)), SLOPE))


class StreamedNetwork(nn.Module):
    """Strided encoder to one code, and a decoder from that code alone.

    Parameters
    ----------
    configuration
        What it consists of.
    """

    def __init__(self, configuration: Streamed) -> None:
        super().__init__()
        check_resolution(configuration)
        width = configuration.width
        self.sides = configuration.sides
        widths = [width, 2 * width, 4 * width, 8 * width, 8 * width]
        self.innermost = (widths[-1], *[configuration.resolution >> HALVINGS] * 2)
        flat = self.innermost[0] * self.innermost[1] ** 2
        self.encoder = nn.Sequential(
            *(
                nn.Sequential(
                    nn.Conv2d(before, after, 4, stride=2, padding=1),
                    nn.GroupNorm(GROUPS, after),
                    nn.LeakyReLU(SLOPE, inplace=True),
                )
                for before, after in zip([1, *widths[:-1]], widths, strict=True)
            )
        )
        self.encode = nn.Linear(flat, configuration.code_size)
        self.decode = nn.Linear(configuration.code_size, flat)
        inward = widths[::-1]
        block = ResidualBlock if configuration.decoder == "residual" else _plain_block
        self.decoder = nn.Sequential(*map(block, inward, [*inward[1:], width]))
        self.head = nn.Conv2d(width, configuration.channels, 3, padding=1)

    def code(self, image: Tensor) -> Tensor:
        """What a body is reduced to, shape (n, code_size), from depth images, shape (n, 1, r, r)."""
        return cast(Tensor, self.encode(self.encoder(image).flatten(1)))

    def decoded(self, code: Tensor) -> Tensor:
        """Depth of each side, then the mask in (0, 1), shape (n, sides + 1, r, r), from codes."""
        innermost = functional.relu(self.decode(code)).view(-1, *self.innermost)
        raw = self.head(self.decoder(innermost))
        return torch.cat([raw[:, : self.sides], torch.sigmoid(raw[:, self.sides :])], dim=1)

    def forward(self, image: Tensor) -> Tensor:
        """Predict the canonical pose; see :meth:`decoded`."""
        return self.decoded(self.code(image))


def _plain_block(before: int, after: int) -> nn.Module:
    return nn.Sequential(
        nn.ConvTranspose2d(before, after, 4, stride=2, padding=1), nn.GroupNorm(GROUPS, after), nn.ReLU()
    )


def build_streamed(configuration: Streamed, seed: int = 0) -> StreamedNetwork:
    """Network with random weights that depend on the seed alone.

    Convolutions before a rectifier start with variances that keep the scale of activations [He et al. 2015, eq. 14].
    """
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        network = StreamedNetwork(configuration)
        for module in network.modules():
            if isinstance(module, (nn.Conv2d, nn.ConvTranspose2d)) and module is not network.head:
                # Products that add up to one output pixel; a stride spreads those of a transposed convolution.
                products = module.in_channels * module.kernel_size[0] ** 2
                if isinstance(module, nn.ConvTranspose2d):
                    products //= module.stride[0] ** 2
                nn.init.normal_(module.weight, std=(2 / ((1 + SLOPE**2) * products)) ** 0.5)
                nn.init.zeros_(module.bias)
            if isinstance(module, ResidualBlock):
                nn.init.constant_(module.second_norm.weight, _SECOND_GAIN)
        with torch.no_grad():
            # Depths begin in the middle of the frame, the mask at the share that a body covers.
            network.head.bias.copy_(torch.tensor([*[0.5] * configuration.sides, MASK_LOGIT]))
    return network
