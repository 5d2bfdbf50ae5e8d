"""Networks with one code: all predicted images come from a few hundred numbers, so no pixel of the pose leaks through.

The blocks are those of :class:`learned.paired.network.GlobalCodeNetwork`; the configuration names the differences.
"""

from __future__ import annotations

from typing import Any, cast

import torch
from torch import Tensor, nn
from torch.nn import functional

from benchmark.api.streaming import N_POINTS
from learned.paired.network import GROUPS, MASK_LOGIT, SLOPE
from learned.streamed.configuration import Streamed, check_resolution

HALVINGS = 5
"""Blocks of the encoder and of the decoder."""

HEADS = 4
"""Heads per attention layer."""

_AVERAGE_GAIN = 10.0
"""Factor of the images of the average body, whose pixels learn independently, not as outputs of a convolution."""

_SHUFFLED = 2
"""Doublings of a decoder that one rearrangement of channels into pixels replaces."""

_RESIDUAL_STAGES = (1, 2)
"""Strided convolutions of a residual encoder that are followed by a residual block."""

_SECOND_GAIN = 0.1
"""Initial scale of the residual branch of a block, so that the block starts close to its skip connection."""


def normalised(channels: int, norm: str) -> nn.Module:
    """Return the normalisation layer of a configuration."""
    if norm == "none":
        return nn.Identity()
    return nn.GroupNorm(GROUPS if norm == "group" else 1, channels)


class StandardisedConv2d(nn.Conv2d):
    """Convolution whose weights have mean 0 and a fixed variance for each output channel, times a learned gain.

    References
    ----------
    Brock, De and Smith, "Characterizing signal propagation to close the performance gap in unnormalized ResNets",
    ICLR 2021.
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


class InnerBlock(nn.Module):
    """Residual block of two convolutions that keep the size.

    Parameters
    ----------
    channels
        Input and output channels.
    norm
        As in :class:`learned.streamed.configuration.Streamed`.
    """

    def __init__(self, channels: int, norm: str) -> None:
        super().__init__()
        self.first, self.second = (convolution(channels, channels, 3, 1, norm) for _ in range(2))
        self.first_norm, self.second_norm = normalised(channels, norm), normalised(channels, norm)
        self.share = nn.Parameter(torch.full((), _SECOND_GAIN))

    def forward(self, x: Tensor) -> Tensor:
        """Map features, shape (n, channels, h, w), to the same shape."""
        inside = functional.leaky_relu(self.first_norm(self.first(x)), SLOPE)
        return functional.leaky_relu(x + self.share * self.second_norm(self.second(inside)), SLOPE)


class Attention(nn.Module):
    """Pre-norm self-attention layer over the pixels of small features [Vaswani et al. 2017].

    Parameters
    ----------
    channels
        Input and output channels.
    side
        Pixels per side.
    """

    def __init__(self, channels: int, side: int) -> None:
        super().__init__()
        self.place = nn.Parameter(torch.zeros(side * side, channels))
        self.before, self.between = nn.LayerNorm(channels), nn.LayerNorm(channels)
        self.mixed, self.out = nn.Linear(channels, 3 * channels), nn.Linear(channels, channels)
        self.wider, self.narrower = nn.Linear(channels, 2 * channels), nn.Linear(2 * channels, channels)
        nn.init.normal_(self.place, std=0.02)
        for last in (self.out, self.narrower):
            nn.init.normal_(last.weight, std=_SECOND_GAIN * channels**-0.5)
            nn.init.zeros_(last.bias)

    def forward(self, x: Tensor) -> Tensor:
        """Map features, shape (n, channels, side, side), to the same shape."""
        tokens = x.flatten(2).transpose(1, 2) + self.place
        n, count, channels = tokens.shape
        parts = self.mixed(self.before(tokens)).view(n, count, 3, HEADS, channels // HEADS).permute(2, 0, 3, 1, 4)
        seen = functional.scaled_dot_product_attention(*parts).transpose(1, 2).reshape(n, count, channels)
        tokens = tokens + self.out(seen)
        tokens = tokens + self.narrower(functional.gelu(self.wider(self.between(tokens))))
        return tokens.transpose(1, 2).reshape(x.shape).contiguous(memory_format=torch.channels_last)


def convolution(before: int, after: int, kernel: int, stride: int, norm: str) -> nn.Conv2d:
    """Return a convolution that keeps or halves the size, with standardised weights if there is no norm."""
    kind = StandardisedConv2d if norm == "none" else nn.Conv2d
    return kind(before, after, kernel, stride=stride, padding=1)


class ResidualBlock(nn.Module):
    """Residual block that doubles the size by interpolation, followed by two convolutions; leaves no checkerboard.

    Parameters
    ----------
    before, after
        Input and output channels.
    norm
        As in :class:`learned.streamed.configuration.Streamed`.
    """

    def __init__(self, before: int, after: int, norm: str) -> None:
        super().__init__()
        self.first = convolution(before, after, 3, 1, norm)
        self.first_norm = normalised(after, norm)
        self.second = convolution(after, after, 3, 1, norm)
        self.second_norm = normalised(after, norm)
        self.around = nn.Conv2d(before, after, 1) if before != after else nn.Identity()

    def forward(self, x: Tensor) -> Tensor:
        """Map features, shape (n, before, h, w), to shape (n, after, 2 h, 2 w)."""
        # A 1x1 convolution commutes with the upsampling, and is cheaper on the small image.
        around = functional.interpolate(self.around(x), scale_factor=2, mode="bilinear", align_corners=False)
        inside = functional.interpolate(x, scale_factor=2, mode="nearest")
        inside = functional.leaky_relu(self.first_norm(self.first(inside)), SLOPE)
        return cast(Tensor, functional.leaky_relu(around + self.second_norm(self.second(inside)), SLOPE))


class StreamedNetwork(nn.Module):
    """Strided encoder to one code, and a decoder from that code alone.

    Parameters
    ----------
    configuration
        Configuration of the network.
    """

    def __init__(self, configuration: Streamed) -> None:
        super().__init__()
        check_resolution(configuration)
        width = configuration.width
        self.sides = configuration.sides
        widths = [width, 2 * width, 4 * width, 8 * width, 8 * width]
        self.innermost = (widths[-1], *[configuration.resolution >> HALVINGS] * 2)
        flat = self.innermost[0] * self.innermost[1] ** 2
        norm = configuration.norm
        stages: list[nn.Module] = []
        for place, (before, after) in enumerate(zip([1, *widths[:-1]], widths, strict=True)):
            side = configuration.resolution >> place
            if place == HALVINGS - 1:
                stages += [Attention(before, side) for _ in range(configuration.attention)]
            stages.append(
                nn.Sequential(
                    convolution(before, after, 4, 2, norm), normalised(after, norm), nn.LeakyReLU(SLOPE, inplace=True)
                )
            )
            if configuration.encoder == "residual" and place in _RESIDUAL_STAGES:
                stages.append(InnerBlock(after, norm))
        self.encoder = nn.Sequential(*stages)
        self.places = nn.Sequential(nn.Conv2d(widths[-2], 12, 1), nn.PixelShuffle(2)) if configuration.places else None
        self.encode = nn.Linear(flat, configuration.code_size)
        self.points = nn.Linear(configuration.code_size, 3 * N_POINTS) if configuration.points else None
        self.decode = nn.Linear(configuration.code_size, flat)
        inward, shuffled = widths[::-1], configuration.decoder == "shuffle"
        block = ResidualBlock if configuration.decoder == "residual" else _plain_block
        outward = [*inward[1:], width][: HALVINGS - (_SHUFFLED if shuffled else 0)]
        self.decoder = nn.Sequential(
            *(block(before, after, norm) for before, after in zip(inward, outward, strict=False))
        )
        enlarged = 2**_SHUFFLED if shuffled else 1
        head = nn.Conv2d(outward[-1], configuration.channels * enlarged**2, 3, padding=1)
        self.head = nn.Sequential(head, nn.PixelShuffle(enlarged)) if shuffled else head
        size = (configuration.channels, *[configuration.resolution] * 2)
        self.average = nn.Parameter(torch.zeros(size)) if configuration.average else None

    def code(self, image: Tensor) -> Tensor:
        """Encode depth images, shape (n, 1, r, r), to codes, shape (n, code_size)."""
        return self.code_and_places(image)[0]

    def code_and_places(self, image: Tensor) -> tuple[Tensor, Tensor | None]:
        """Return the codes, and the canonical positions in coarse pixels, shape (n, 3, r / 8, r / 8), or None."""
        features = self.encoder[:-1](image)
        places = self.places(features) if self.places is not None else None
        return self.encode(self.encoder[-1](features).flatten(1)), places

    def decoded(self, code: Tensor) -> Tensor:
        """Decode codes to the depth of each side, then the mask in (0, 1), shape (n, sides + 1, r, r)."""
        innermost = functional.relu(self.decode(code)).view(-1, *self.innermost)
        raw = self.head(self.decoder(innermost))
        if self.average is not None:
            raw = raw + _AVERAGE_GAIN * self.average
        depths, mask = raw.split([self.sides, 1], dim=1)
        return torch.cat([depths, torch.sigmoid(mask)], dim=1)

    def forward(self, image: Tensor) -> Tensor:
        """Predict the canonical pose; see :meth:`decoded`."""
        return self.decoded(self.code(image))


def _plain_block(before: int, after: int, norm: str) -> nn.Module:
    return nn.Sequential(nn.ConvTranspose2d(before, after, 4, stride=2, padding=1), normalised(after, norm), nn.ReLU())


def build_streamed(configuration: Streamed, seed: int = 0) -> StreamedNetwork:
    """Build a network with random weights that depend only on the seed.

    Convolutions before a rectifier start with variances that keep the scale of activations [He et al. 2015, eq. 14].
    """
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        network = StreamedNetwork(configuration)
        head = network.head[0] if isinstance(network.head, nn.Sequential) else network.head
        for module in network.modules():
            if isinstance(module, (nn.Conv2d, nn.ConvTranspose2d)) and module is not head:
                # Products per output pixel; a stride spreads those of a transposed convolution.
                products = module.in_channels * module.kernel_size[0] ** 2
                if isinstance(module, nn.ConvTranspose2d):
                    products //= module.stride[0] ** 2
                nn.init.normal_(module.weight, std=(2 / ((1 + SLOPE**2) * products)) ** 0.5)
                nn.init.zeros_(module.bias)
            if isinstance(module, ResidualBlock) and isinstance(module.second_norm, nn.GroupNorm):
                nn.init.constant_(module.second_norm.weight, _SECOND_GAIN)
        with torch.no_grad():
            # Depths start in the middle of the frame, the mask at about the share that a body covers.
            first = torch.tensor([*[0.5] * configuration.sides, MASK_LOGIT])
            head.bias.copy_(first.repeat_interleave(len(head.bias) // len(first)))
            if configuration.average:
                head.weight.mul_(_SECOND_GAIN)
    return network
