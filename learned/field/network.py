"""Network of the field: encodes surface points to tokens, and decodes positions to their place in the canonical pose.

Neighbourhoods become tokens as in PointNet++ [Qi et al. 2017, section 3.2]. Tokens attend to each other, and positions
to tokens [Vaswani et al. 2017, section 3.2]. As in deformation fields [DIF-Net, Deng et al. 2021, section 3], the
canonical position is a function of the position and a code of the whole shape; here the code is a set of tokens, one of
which has no position.
"""

from __future__ import annotations

import math
from typing import NamedTuple, cast

import torch
from torch import Tensor, nn
from torch.nn import functional

from learned.field.configuration import Field, check_sizes

SHARPNESS = (1.0, 200.0)
"""Initial decay of attention with distance, in the widest and the narrowest head: factors of squared distances, in
units of 1 / area. The narrowest head sees the nearest few of a hundred tokens."""

REACH = 0.15
"""Unit of relative positions in a neighbourhood, in units of sqrt(area): about the radius of one of a hundred."""


class Tokens(NamedTuple):
    """Tokens of a batch of shapes.

    Parameters
    ----------
    features
        Shape (n, tokens + 1, width); the first token has no position.
    places
        Positions, shape (n, tokens, 3).
    """

    features: Tensor
    places: Tensor


class Unbent(NamedTuple):
    """Output of the field at positions.

    Parameters
    ----------
    positions
        Positions in the canonical pose, shape (n, q, 3), of a body of unit area with its centroid at the origin.
    rotations
        Rotation of the surface around each position to the canonical pose, shape (n, q, 3, 3).
    """

    positions: Tensor
    rotations: Tensor


class Attention(nn.Module):
    """Attention that decays with distance, at a learned rate per head, followed by a two-layer perceptron.

    Parameters
    ----------
    width, heads
        See :class:`learned.field.configuration.Field`.
    """

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.heads = heads
        self.norm = nn.LayerNorm(width)
        self.query = nn.Linear(width, width)
        self.key_value = nn.Linear(width, 2 * width)
        self.out = nn.Linear(width, width)
        least, most = map(math.log, SHARPNESS)
        self.log_sharpness = nn.Parameter(torch.linspace(least, most, heads))
        self.mlp = nn.Sequential(
            nn.LayerNorm(width), nn.Linear(width, 4 * width), nn.GELU(), nn.Linear(4 * width, width)
        )

    def forward(self, asking: Tensor, asked: Tensor, squares: Tensor) -> Tensor:
        """Return new features, shape (n, q, width).

        Parameters
        ----------
        asking
            Features of the queries, shape (n, q, width).
        asked
            Normalised features of the keys and values, shape (n, t, width).
        squares
            Squared distances between them, shape (n, q, t); 0 for a token without position.
        """
        query = self._of_heads(self.query(self.norm(asking)))
        key, value = (self._of_heads(part) for part in self.key_value(asked).chunk(2, dim=-1))
        bias = -self.log_sharpness.exp()[:, None, None] * squares[:, None]
        attended = functional.scaled_dot_product_attention(query, key, value, attn_mask=bias.to(query.dtype))
        asking = asking + self.out(attended.transpose(1, 2).flatten(2))
        return cast(Tensor, asking + self.mlp(asking))

    def _of_heads(self, features: Tensor) -> Tensor:
        return features.unflatten(-1, (self.heads, -1)).transpose(1, 2)


class FieldNetwork(nn.Module):
    """Encoder of points and decoder of positions.

    Parameters
    ----------
    configuration
        Sizes of the network.
    """

    def __init__(self, configuration: Field) -> None:
        super().__init__()
        check_sizes(configuration)
        width, heads = configuration.width, configuration.heads
        self.n_points = configuration.points
        self.n_tokens, self.n_neighbours = configuration.tokens, configuration.neighbours
        self.frequencies = configuration.frequencies
        written = 3 * (2 + 2 * configuration.frequencies)
        self.neighbourhood = nn.Sequential(nn.Linear(9, width // 3), nn.ReLU(), nn.Linear(width // 3, width), nn.ReLU())
        self.gathered = nn.Linear(width, width)
        self.placed = nn.Linear(written, width)
        self.whole = nn.Parameter(torch.zeros(1, 1, width))
        self.encoder = nn.ModuleList(Attention(width, heads) for _ in range(configuration.encoder_layers))
        self.asked_norms = nn.ModuleList(nn.LayerNorm(width) for _ in range(configuration.encoder_layers))
        self.code_norm = nn.LayerNorm(width)
        self.asking = nn.Sequential(nn.Linear(written, width), nn.GELU(), nn.Linear(width, width))
        self.decoder = nn.ModuleList(Attention(width, heads) for _ in range(configuration.decoder_layers))
        self.head = nn.Sequential(nn.LayerNorm(width), nn.Linear(width, 9))

    def encoded(self, points: Tensor, normals: Tensor) -> Tokens:
        """Encode shapes to tokens.

        Parameters
        ----------
        points
            Points of each surface, of which the first few are spread as evenly as all, shape (n, m, 3).
        normals
            Unit normals there, shape (n, m, 3).
        """
        places, place_normals = points[:, : self.n_tokens], normals[:, : self.n_tokens]
        gathered = self.gathered(self._neighbourhoods(points, normals, places, place_normals))
        features = gathered + self.placed(self._written(places, place_normals))
        features = torch.cat([self.whole.expand(len(features), -1, -1).to(features.dtype), features], dim=1)
        squares = functional.pad(_squares(places, places), (1, 0, 1, 0))
        for layer, norm in zip(self.encoder, self.asked_norms, strict=True):
            features = layer(features, norm(features), squares)
        return Tokens(self.code_norm(features), places)

    def decoded(self, tokens: Tokens, positions: Tensor, normals: Tensor) -> Unbent:
        """Decode positions on the surfaces with these tokens.

        Parameters
        ----------
        tokens
            Tokens of n shapes.
        positions, normals
            Shape (n, q, 3).
        """
        squares = functional.pad(_squares(positions, tokens.places), (1, 0))
        features = self.asking(self._written(positions, normals))
        for layer in self.decoder:
            features = layer(features, tokens.features, squares)
        raw = self.head(features)
        raw = raw.to(torch.promote_types(raw.dtype, torch.float32))  # training computes in bfloat16
        return Unbent(raw[..., :3], rotations_of(raw[..., 3:]))

    def forward(self, points: Tensor, normals: Tensor, positions: Tensor, position_normals: Tensor) -> Unbent:
        """Encode and decode; see :meth:`encoded` and :meth:`decoded`."""
        return self.decoded(self.encoded(points, normals), positions, position_normals)

    def _neighbourhoods(self, points: Tensor, normals: Tensor, places: Tensor, place_normals: Tensor) -> Tensor:
        """Max-pool the features of the neighbourhood of each token, shape (n, tokens, width).

        The weight of a point falls to zero towards the rim of the neighbourhood, so ties between the farthest points do
        not matter.
        """
        nearest, which = _squares(places, points).topk(self.n_neighbours, dim=-1, largest=False)
        n, t, k = which.shape
        rows = which.reshape(n, t * k, 1).expand(-1, -1, 3)
        around = points.gather(1, rows).view(n, t, k, 3) - places[:, :, None]
        facing = normals.gather(1, rows).view(n, t, k, 3)
        own = place_normals[:, :, None].expand_as(facing)
        weights = (1 - nearest / nearest[..., -1:].clamp(min=torch.finfo(nearest.dtype).tiny)).clamp(min=0)
        seen = self.neighbourhood(torch.cat([around / REACH, facing, own], dim=-1))
        return cast(Tensor, (seen * weights[..., None]).amax(dim=2))

    def _written(self, positions: Tensor, normals: Tensor) -> Tensor:
        """Return positions, normals, and octaves of sines and cosines, shape (n, q, 3 (2 + 2 frequencies))."""
        octaves = 2.0 ** torch.arange(self.frequencies, device=positions.device) * (math.pi / 2)
        phases = (positions[..., None] * octaves).flatten(-2)
        return torch.cat([positions, normals, phases.sin(), phases.cos()], dim=-1)


def rotations_of(raw: Tensor) -> Tensor:
    """Return rotations from two columns each, orthonormalised [Zhou et al. 2019, equation 15].

    Parameters
    ----------
    raw
        Differences between the two columns and those of the identity, shape (..., 6).

    Returns
    -------
    torch.Tensor
        Shape (..., 3, 3).
    """
    first, second = (raw + raw.new_tensor([1.0, 0, 0, 0, 1, 0])).unflatten(-1, (2, 3)).unbind(-2)
    first = functional.normalize(first, dim=-1)
    second = functional.normalize(second - (first * second).sum(-1, keepdim=True) * first, dim=-1)
    return torch.stack([first, second, torch.linalg.cross(first, second)], dim=-1)


def _squares(one: Tensor, other: Tensor) -> Tensor:
    """Return squared distances between points, shape (n, a, b), from differences to avoid cancellation."""
    return sum((one[:, :, None, k] - other[:, None, :, k]).square() for k in range(3))


def build_field(configuration: Field, seed: int = 0) -> FieldNetwork:
    """Build a network with random weights that depend only on the seed."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        network = FieldNetwork(configuration)
        last = cast(nn.Linear, network.head[-1])
        # Initially all positions are predicted near the centroid, with almost no rotation.
        nn.init.normal_(last.weight, std=0.02)
        nn.init.zeros_(last.bias)
        nn.init.normal_(network.whole, std=0.02)
    return network
