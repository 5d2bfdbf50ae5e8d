"""The paper's network: short-range features, long-range features, and an encoder-decoder for depth and mask.

"Deep Learning for Canonical Reconstruction of Deformable Objects from Depth Images in Robotic Vision and SLAM-Aware
Perception", section III. Y_SRF = SRF(I), Y_LRF = LRF(I, Y_SRF), (depth, mask) = DPR(I, Y_SRF, Y_LRF), each of the size
of the image. The paper counts the blocks of SRF in three ways: five convolution layers, nine blocks of a convolution
and a transposed one, and a figure of nine blocks. This SRF has five convolutions and four transposed ones: five layers
and nine blocks, but not both kinds in each block.
"""

from __future__ import annotations

from typing import cast

import torch
from torch import Tensor, nn
from torch.nn import functional

from learned.paired.configuration import Configuration

SLOPE = 0.2
"""Slope of LeakyReLU below zero."""

DILATIONS = (2, 3, 4, 5, 6)
"""Dilations of the blocks of LRF."""

CONVOLUTIONS, DECONVOLUTIONS = 5, 4
"""Blocks of SRF."""

GROUPS = 8
"""Number of channel groups in group normalisation."""

CHANNELS = 2
"""Output channels: depth and mask."""

MASK_LOGIT = -2.5
"""Initial logit of the mask, about the share of a frame that a shape covers. Without it, the first steps, which see
mostly background, saturate the sigmoid, and the mask stays at zero."""


def _rectifier() -> nn.LeakyReLU:
    """Return the activation after a convolution; in place, because no gradient needs its input."""
    return nn.LeakyReLU(SLOPE, inplace=True)


class SameSizeDeconvolution(nn.ConvTranspose2d):
    """Transposed convolution of stride 1, computed as a convolution with the kernel rotated by 180 degrees.

    In bfloat16, torch takes half as long for the gradients of a convolution as for those of a transposed one.
    """

    def __init__(self, channels_in: int, channels_out: int, kernel_size: int, padding: int, dilation: int = 1) -> None:
        super().__init__(channels_in, channels_out, kernel_size, padding=padding, dilation=dilation)

    def forward(self, x: Tensor, output_size: list[int] | None = None) -> Tensor:
        """Compute the transposed convolution, shape (n, channels_out, h, w) for a padding that keeps the size."""
        padding = self.dilation[0] * (self.kernel_size[0] - 1) - int(self.padding[0])
        kernel = self.weight.transpose(0, 1).flip(2, 3)
        return functional.conv2d(x, kernel, self.bias, padding=padding, dilation=self.dilation)


class ShortRangeFeatures(nn.Sequential):
    """SRF: nine blocks at full size, five convolutions and four transposed ones, with one output channel.

    Parameters
    ----------
    width
        Channels inside.
    """

    def __init__(self, width: int) -> None:
        channels = [1, *[width] * (CONVOLUTIONS + DECONVOLUTIONS - 1), 1]
        kinds = [nn.Conv2d] * CONVOLUTIONS + [SameSizeDeconvolution] * DECONVOLUTIONS
        blocks = [
            nn.Sequential(kind(before, after, 3, padding=1), _rectifier())
            for kind, before, after in zip(kinds, channels[:-1], channels[1:], strict=True)
        ]
        super().__init__(*blocks)


class LongRangeFeatures(nn.Sequential):
    """LRF: five blocks with dilations 2 to 6 at full size, with one output channel.

    A transposed convolution of the same dilation follows each convolution, according to the caption of the paper's
    figure but not to its text.

    Parameters
    ----------
    channels_in
        Channels of the image and of the features concatenated to it.
    width
        Channels inside.
    """

    def __init__(self, channels_in: int, width: int) -> None:
        blocks = []
        for place, dilation in enumerate(DILATIONS):
            before = channels_in if place == 0 else width
            after = 1 if place == len(DILATIONS) - 1 else width
            block = nn.Sequential(
                nn.Conv2d(before, width, 3, padding=dilation, dilation=dilation),
                _rectifier(),
                SameSizeDeconvolution(width, after, 3, padding=dilation, dilation=dilation),
                _rectifier(),
            )
            blocks.append(block)
        super().__init__(*blocks)


class EncoderDecoder(nn.Module):
    """DPR: four blocks of convolution, LeakyReLU and max-pooling, four of transposed convolution and ReLU, a 1x1 head.

    Parameters
    ----------
    channels_in
        Channels of the image and of the features concatenated to it.
    width
        Channels of the outermost block; each inner one has twice as many.
    """

    def __init__(self, channels_in: int, width: int) -> None:
        super().__init__()
        widths = [width, 2 * width, 4 * width, 8 * width]
        befores = [channels_in, *widths[:-1]]
        self.encoder = nn.ModuleList(
            nn.Sequential(nn.Conv2d(before, after, 3, padding=1), _rectifier())
            for before, after in zip(befores, widths, strict=True)
        )
        innermost = widths[::-1]
        afters = [*innermost[1:], width]
        # 4x4 kernels cover every pixel of the doubled size equally often; 3x3 kernels make a checkerboard.
        self.decoder = nn.ModuleList(
            nn.ConvTranspose2d(before, after, 4, stride=2, padding=1)
            for before, after in zip(innermost, afters, strict=True)
        )
        self.head = nn.Conv2d(width, CHANNELS, 1)

    def forward(self, x: Tensor) -> Tensor:
        """Map features, shape (n, channels, h, w), to depth and the log-odds of the mask, shape (n, 2, h, w)."""
        sizes = []
        for block in self.encoder:
            sizes.append(x.shape[-2:])
            # Rounding up keeps the last row and column of an odd size, so that the decoder can restore it.
            x = functional.max_pool2d(block(x), 2, ceil_mode=True)
        for deconvolution, (height, width) in zip(self.decoder, reversed(sizes), strict=True):
            x = deconvolution(x)
            if x.shape[-2:] != (height, width):  # an empty cut would cost two copies in the backward pass
                x = x[..., :height, :width]
            x = functional.relu(x)
        return cast(Tensor, self.head(x))


class ProgressiveNetwork(nn.Module):
    """SRF, LRF and DPR in sequence; each sees the image and all features before it.

    Parameters
    ----------
    configuration
        Parts of the network, and their width.
    """

    def __init__(self, configuration: Configuration) -> None:
        super().__init__()
        width, channels = configuration.width, 1
        self.short_range = ShortRangeFeatures(width) if configuration.short_range else None
        channels += configuration.short_range
        self.long_range = LongRangeFeatures(channels, width) if configuration.long_range else None
        channels += configuration.long_range
        self.reconstruction = EncoderDecoder(channels, 2 * width)

    def forward(self, image: Tensor) -> Tensor:
        """Predict the canonical pose.

        Parameters
        ----------
        image
            Depth images, shape (n, 1, h, w), in [0, 1] with 0 as background.

        Returns
        -------
        torch.Tensor
            Depth, about (0, 1), and mask in (0, 1), shape (n, 2, h, w).
        """
        features = image
        for part in (self.short_range, self.long_range):
            if part is not None:
                features = torch.cat([features, part(features)], dim=1)
        return _depth_and_mask(self.reconstruction(features))


class GlobalCodeNetwork(nn.Module):
    """Strided encoder to one vector, and a decoder from that vector alone: no pixel of the pose can leak through.

    Parameters
    ----------
    configuration
        Width of the outermost block and length of the vector.
    """

    INNERMOST = 4
    """Pixels per side of the innermost features; the image has 2^5 times as many."""

    def __init__(self, configuration: Configuration) -> None:
        super().__init__()
        width = configuration.width
        widths = [width, 2 * width, 4 * width, 8 * width, 8 * width]

        def block(before: int, after: int) -> nn.Sequential:
            convolution = nn.Conv2d(before, after, 4, stride=2, padding=1)
            return nn.Sequential(convolution, nn.GroupNorm(GROUPS, after), _rectifier())

        def unblock(before: int, after: int) -> nn.Sequential:
            deconvolution = nn.ConvTranspose2d(before, after, 4, stride=2, padding=1)
            return nn.Sequential(deconvolution, nn.GroupNorm(GROUPS, after), nn.ReLU())

        flat = widths[-1] * self.INNERMOST**2
        self.encoder = nn.Sequential(*map(block, [1, *widths[:-1]], widths))
        self.encode = nn.Linear(flat, configuration.code_size)
        self.decode = nn.Linear(configuration.code_size, flat)
        inward = widths[::-1]
        self.decoder = nn.Sequential(*map(unblock, inward, [*inward[1:], width]))
        self.head = nn.Conv2d(width, CHANNELS, 3, padding=1)

    def forward(self, image: Tensor) -> Tensor:
        """Predict depth and mask; see :meth:`ProgressiveNetwork.forward`. Images have 128 x 128 pixels."""
        innermost = self.encoder(image)
        code = self.encode(innermost.flatten(1))
        decoded = functional.relu(self.decode(code)).view_as(innermost)
        return _depth_and_mask(self.head(self.decoder(decoded)))


def _depth_and_mask(x: Tensor) -> Tensor:
    """Leave the depth, which is regressed, and squash the mask into (0, 1); shape (n, 2, h, w)."""
    return torch.stack([x[:, 0], torch.sigmoid(x[:, 1])], dim=1)


RESOLUTIONS = {"progressive": range(32, 2049), "global-code": (128,)}
"""Pixels per side that each architecture supports."""


def build(configuration: Configuration, seed: int = 0) -> nn.Module:
    """Build a network with random weights that depend only on the seed.

    Convolutions before a (leaky) rectifier start with variances that keep the scale of activations [He et al. 2015, eq.
    14].
    """
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        kind = ProgressiveNetwork if configuration.architecture == "progressive" else GlobalCodeNetwork
        network: nn.Module = kind(configuration)
        for module in network.modules():
            if isinstance(module, (nn.Conv2d, nn.ConvTranspose2d)) and module.out_channels != CHANNELS:
                # Products per output pixel; a stride spreads those of a transposed convolution.
                products = module.in_channels * module.kernel_size[0] ** 2
                if isinstance(module, nn.ConvTranspose2d):
                    products //= module.stride[0] ** 2
                nn.init.normal_(module.weight, std=(2 / ((1 + SLOPE**2) * products)) ** 0.5)
                nn.init.zeros_(module.bias)
        head = network.get_submodule("head" if isinstance(network, GlobalCodeNetwork) else "reconstruction.head")
        with torch.no_grad():
            head.bias.copy_(torch.tensor([0.0, MASK_LOGIT]))
    return network
