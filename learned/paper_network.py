"""The paper's network: short-range and long-range features, and an encoder-decoder.

"Deep Learning for Canonical Reconstruction of Deformable Objects from Depth Images in Robotic
Vision and SLAM-Aware Perception", section III. Y_SRF = SRF(I), Y_LRF = LRF(I, Y_SRF), (depth, mask)
= DPR(I, Y_SRF, Y_LRF), each of the size of the image. Transposed convolutions of the paper that
keep the size (stride 1) are convolutions here, because both compute the same functions.
"""

from __future__ import annotations

from typing import cast

import torch
from torch import Tensor, nn
from torch.nn import functional

SLOPE = 0.2
"""Slope of LeakyReLU below zero."""

SHORT_RANGE = (1,) * 9
"""Dilations of SRF."""
LONG_RANGE = (2, 2, 3, 3, 4, 4, 5, 5, 6, 6)
"""Dilations of LRF.

Each of its five blocks has a convolution and, by the caption of the figure, a transposed one.
"""

RESOLUTIONS = range(32, 2049)
"""Pixels per side of an image."""

MASK_LOGIT = -2.5
"""Initial logit of the mask, about the share of a frame that a shape covers.

Without it, the first steps, which see mostly background, saturate the sigmoid, and the mask stays
at zero.
"""


def _block(before: int, after: int, dilation: int = 1) -> nn.Sequential:
    """Return a convolution that keeps the size of an image, and its activation."""
    convolution = nn.Conv2d(before, after, 3, padding=dilation, dilation=dilation)
    # In place, because no gradient needs the input of the activation.
    return nn.Sequential(convolution, nn.LeakyReLU(SLOPE, inplace=True))


def convolutions(channels_in: int, width: int, dilations: tuple[int, ...]) -> nn.Sequential:
    """Return SRF or LRF: convolutions at full size with these dilations.

    The last has one output channel.
    """
    channels = [channels_in, *[width] * (len(dilations) - 1), 1]
    return nn.Sequential(*map(_block, channels[:-1], channels[1:], dilations))


class EncoderDecoder(nn.Module):
    """DPR: an encoder-decoder to depth and mask.

    Four blocks of convolution, LeakyReLU and max-pooling, four of transposed convolution and ReLU,
    and a 1x1 head.

    Parameters
    ----------
    channels_in
        Channels of the image and of the features concatenated to it.
    width
        Channels of the outermost block; each inner one has twice as many.
    """

    def __init__(self, channels_in: int, width: int) -> None:
        """Make the blocks of encoder and decoder, and the head.

        Parameters
        ----------
        channels_in
            Channels of the input.
        width
            Channels of the first block; the number doubles with each of the others.
        """
        super().__init__()
        widths = [width, 2 * width, 4 * width, 8 * width]
        inward = widths[::-1]
        self.encoder = nn.ModuleList(map(_block, [channels_in, *widths[:-1]], widths))
        # 4x4 kernels cover every pixel of the doubled size equally often; 3x3 kernels make a
        # checkerboard.
        self.decoder = nn.ModuleList(
            nn.ConvTranspose2d(before, after, 4, stride=2, padding=1)
            for before, after in zip(inward, [*inward[1:], width], strict=True)
        )
        self.head = nn.Conv2d(width, 2, 1)

    def forward(self, x: Tensor) -> Tensor:
        """Map features to depth and mask.

        Parameters
        ----------
        x
            Channels of the image and further features, shape (n, channels, h, w).

        Returns
        -------
        torch.Tensor
            Depth and log-odds of the mask, shape (n, 2, h, w).
        """
        sizes = []
        for block in self.encoder:
            sizes.append(x.shape[-2:])
            # Rounding up keeps the last row and column of an odd size for the decoder.
            x = functional.max_pool2d(block(x), 2, ceil_mode=True)
        for deconvolution, size in zip(self.decoder, reversed(sizes), strict=True):
            x = deconvolution(x)
            # Cut off what rounding up has added. A cut that changes nothing would cost two copies
            # in the backward pass.
            if x.shape[-2:] != size:
                x = x[..., : size[0], : size[1]]
            x = functional.relu(x)
        return cast(Tensor, self.head(x))


class PaperNetwork(nn.Module):
    """SRF, LRF and DPR in sequence; each sees the image and all features before it.

    Parameters
    ----------
    width
        Channels of SRF and LRF; DPR has 2, 4, 8 and 16 times as many. The paper names no widths.
    short_range, long_range
        Whether the network has SRF and LRF.
    seed
        Seed of the random weights, which depend on nothing else. Convolutions before a (leaky)
        rectifier start with variances that keep the scale of activations [He et al. 2015, eq. 14].
    """

    def __init__(
        self, width: int = 16, short_range: bool = True, long_range: bool = True, seed: int = 0
    ) -> None:
        """Make the parts with random weights; their names stand in files of weights."""
        super().__init__()
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            channels = 1 + int(short_range)
            self.short_range = convolutions(1, width, SHORT_RANGE) if short_range else None
            self.long_range = convolutions(channels, width, LONG_RANGE) if long_range else None
            self.reconstruction = EncoderDecoder(channels + int(long_range), 2 * width)
            initialise(self, self.reconstruction.head)

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
        depth, mask = self.reconstruction(features).unbind(1)
        return torch.stack([depth, torch.sigmoid(mask)], dim=1)


def initialise(network: nn.Module, head: nn.Conv2d) -> None:
    """Draw the initial weights of a network in place.

    The weights of all convolutions but the head are normal, with a variance by which each layer
    keeps the variance of its input [He et al. 2015]. The head keeps its weights; its biases make
    the mask start at about the share of an image that a shape covers.

    Parameters
    ----------
    network
        The network, changed in place.
    head
        Its last layer, with two channels: depth, and log-odds of the mask.
    """
    for module in network.modules():
        if isinstance(module, (nn.Conv2d, nn.ConvTranspose2d)) and module is not head:
            # Number of products that are summed up for a pixel of the output. A transposed
            # convolution spreads them over the pixels of its stride.
            products = module.in_channels * module.kernel_size[0] ** 2
            if isinstance(module, nn.ConvTranspose2d):
                products //= module.stride[0] ** 2
            nn.init.normal_(module.weight, std=(2 / ((1 + SLOPE**2) * products)) ** 0.5)
            nn.init.zeros_(cast(Tensor, module.bias))
    with torch.no_grad():
        cast(Tensor, head.bias).copy_(torch.tensor([0.0, MASK_LOGIT]))
