"""Network of the deformation field: from a surface to tokens, and from positions to canonical ones.

Neighbourhoods become tokens as in PointNet++ [Qi et al. 2017, section 3.2]. Tokens attend to each
other, and positions to tokens [Vaswani et al. 2017, section 3.2]. As in deformation fields
[DIF-Net, Deng et al. 2021, section 3], the canonical position is a function of the position and a
code of the whole shape; here the code is a set of tokens, one of which has no position.
"""

from __future__ import annotations

import math
from typing import NamedTuple, cast

import torch
from torch import Tensor, nn
from torch.nn import functional

N_POINTS = 1024
"""Points of a surface."""

N_TOKENS = 128
"""Neighbourhoods."""

N_NEIGHBOURS = 32
"""Points in each neighbourhood."""

TOKEN_WIDTH = 192
"""Features of a token."""

HEADS = 6
"""Heads of an attention layer."""

ENCODER_LAYERS = 6
"""Attention layers among tokens."""

DECODER_LAYERS = 2
"""Attention layers from positions to tokens."""
FREQUENCIES = 5
"""Octaves of the positional encoding [Mildenhall et al. 2020, equation 4]."""

#: Numbers of a neighbour: its offset, its normal, and the normal at the centre.
_N_OF_NEIGHBOUR = 3 + 3 + 3

#: Numbers of an answer: a position, and two columns of a rotation.
_N_OF_ANSWER = 3 + 6

_RADIUS = 0.15
"""Unit of relative positions in a neighbourhood, in units of sqrt(area).

It is about the radius of one of a hundred neighbourhoods.
"""


class Tokens(NamedTuple):
    """Code of a surface.

    Parameters
    ----------
    features
        Shape (n, tokens + 1, width); the first token has no position.
    positions
        Shape (n, tokens, 3).
    """

    features: Tensor
    positions: Tensor


class FieldNetwork(nn.Module):
    """Encoder of points and decoder of positions."""

    def __init__(self) -> None:
        """Make the layers of the encoder and of the decoder, with weights drawn by torch.

        Names of layers stand in files of weights; the order of layers decides which draws they get.
        """
        super().__init__()
        # What positional encoding gives: a position, a normal, and a sine and a cosine of each
        # coordinate at each frequency.
        n_encoded = 3 * (2 + 2 * FREQUENCIES)
        # Encoder. A perceptron turns each neighbour of a token into features; their maximum over
        # the neighbourhood passes ``gathered``, and the encoded position of the token ``placed``.
        # The sum of both is the token.
        self.neighbourhood = nn.Sequential(
            nn.Linear(_N_OF_NEIGHBOUR, TOKEN_WIDTH // 3),
            nn.ReLU(),
            nn.Linear(TOKEN_WIDTH // 3, TOKEN_WIDTH),
            nn.ReLU(),
        )
        self.gathered = nn.Linear(TOKEN_WIDTH, TOKEN_WIDTH)
        self.placed = nn.Linear(n_encoded, TOKEN_WIDTH)
        # One more token stands for the whole shape. Tokens attend to each other; ``asked_norms``
        # normalise their keys and values in each layer, ``code_norm`` the finished tokens.
        self.whole = nn.Parameter(torch.zeros(1, 1, TOKEN_WIDTH))
        self.encoder = nn.ModuleList(Attention() for _ in range(ENCODER_LAYERS))
        self.asked_norms = nn.ModuleList(nn.LayerNorm(TOKEN_WIDTH) for _ in range(ENCODER_LAYERS))
        self.code_norm = nn.LayerNorm(TOKEN_WIDTH)
        # Decoder. An encoded position becomes a query (``asking``), which attends to the tokens;
        # the head turns it into a canonical position and a rotation.
        self.asking = nn.Sequential(
            nn.Linear(n_encoded, TOKEN_WIDTH), nn.GELU(), nn.Linear(TOKEN_WIDTH, TOKEN_WIDTH)
        )
        self.decoder = nn.ModuleList(Attention() for _ in range(DECODER_LAYERS))
        self.head = nn.Sequential(nn.LayerNorm(TOKEN_WIDTH), nn.Linear(TOKEN_WIDTH, _N_OF_ANSWER))

    def encoded(self, points: Tensor, normals: Tensor) -> Tokens:
        """Encode shapes to tokens.

        Parameters
        ----------
        points
            Points of each surface, of which the first few are spread as evenly as all, shape (n, m,
            3).
        normals
            Unit normals there, shape (n, m, 3).
        """
        positions = points[:, :N_TOKENS]
        facing = normals[:, :N_TOKENS]
        gathered = self.gathered(self._neighbourhoods(points, normals, positions, facing))
        features = gathered + self.placed(_positional_encoding(positions, facing))
        features = torch.cat([self.whole.expand(len(features), -1, -1), features], dim=1)
        squares = functional.pad(_squares(positions, positions), (1, 0, 1, 0))
        for layer, norm in zip(self.encoder, self.asked_norms, strict=True):
            features = layer(features, norm(features), squares)
        return Tokens(self.code_norm(features), positions)

    def decoded(self, tokens: Tokens, positions: Tensor, normals: Tensor) -> tuple[Tensor, Tensor]:
        """Decode positions on the surfaces with these tokens, shape (n, q, 3).

        Returns
        -------
        positions, rotations : torch.Tensor
            Positions in the canonical pose of a body of unit area, shape (n, q, 3), and rotations
            of the surface around each position to the canonical pose, shape (n, q, 3, 3).
        """
        squares = functional.pad(_squares(positions, tokens.positions), (1, 0))
        features = self.asking(_positional_encoding(positions, normals))
        for layer in self.decoder:
            features = layer(features, tokens.features, squares)
        raw = self.head(features)
        return raw[..., :3], rotations_of(raw[..., 3:])

    def _neighbourhoods(
        self, points: Tensor, normals: Tensor, positions: Tensor, facing: Tensor
    ) -> Tensor:
        """Return the features of the neighbourhood of each token.

        A perceptron computes features of each of the nearest points, and their maximum over the
        neighbourhood is taken. The weight of a point falls to zero towards the farthest one, so
        that it does not matter which of equally far points belong to the neighbourhood.

        Parameters
        ----------
        points, normals
            Points of each surface and unit normals there, shape (n, m, 3).
        positions, facing
            Positions of the tokens, which are the centres of the neighbourhoods, and unit normals
            there, shape (n, tokens, 3).

        Returns
        -------
        torch.Tensor
            Shape (n, tokens, width).
        """
        squares, neighbours = _squares(positions, points).topk(N_NEIGHBOURS, dim=-1, largest=False)
        # Gather the points of each neighbourhood, relative to its token, and the normals there.
        n_shapes, n_tokens, n_neighbours = neighbours.shape
        size = (n_shapes, n_tokens, n_neighbours, 3)
        rows = neighbours.reshape(n_shapes, n_tokens * n_neighbours, 1).expand(-1, -1, 3)
        offsets = points.gather(1, rows).view(size) - positions[:, :, None]
        normals_around = normals.gather(1, rows).view(size)
        normals_at_token = facing[:, :, None].expand_as(normals_around)
        farthest = squares[..., -1:].clamp(min=torch.finfo(squares.dtype).tiny)
        weights = (1 - squares / farthest).clamp(min=0)
        inputs = torch.cat([offsets / _RADIUS, normals_around, normals_at_token], dim=-1)
        features = self.neighbourhood(inputs)
        return cast(Tensor, (features * weights[..., None]).amax(dim=2))


class Attention(nn.Module):
    """Attention that decays with distance, and a two-layer perceptron.

    It decays at a learned rate per head.
    """

    def __init__(self) -> None:
        """Make the layers of an attention block.

        ``log_sharpness`` is the logarithm of the rate at which the attention of each head falls
        with the distance between two tokens.
        """
        super().__init__()
        self.norm = nn.LayerNorm(TOKEN_WIDTH)
        self.query = nn.Linear(TOKEN_WIDTH, TOKEN_WIDTH)
        self.key_value = nn.Linear(TOKEN_WIDTH, 2 * TOKEN_WIDTH)
        self.out = nn.Linear(TOKEN_WIDTH, TOKEN_WIDTH)
        self.log_sharpness = nn.Parameter(torch.linspace(0, math.log(200), HEADS))
        self.mlp = nn.Sequential(
            nn.LayerNorm(TOKEN_WIDTH),
            nn.Linear(TOKEN_WIDTH, 4 * TOKEN_WIDTH),
            nn.GELU(),
            nn.Linear(4 * TOKEN_WIDTH, TOKEN_WIDTH),
        )

    def forward(self, queries: Tensor, context: Tensor, squares: Tensor) -> Tensor:
        """Return new features, shape (n, q, width).

        Parameters
        ----------
        queries
            Features of the queries, shape (n, q, width).
        context
            Normalised features of the keys and values, shape (n, t, width).
        squares
            Squared distances between them, shape (n, q, t); 0 for a token without position.
        """
        query = self._of_heads(self.query(self.norm(queries)))
        key, value = (self._of_heads(part) for part in self.key_value(context).chunk(2, dim=-1))
        bias = -self.log_sharpness.exp()[:, None, None] * squares[:, None]
        attended = functional.scaled_dot_product_attention(query, key, value, attn_mask=bias)
        queries = queries + self.out(attended.transpose(1, 2).flatten(2))
        return cast(Tensor, queries + self.mlp(queries))

    def _of_heads(self, features: Tensor) -> Tensor:
        """Return features divided among the heads, shape (n, heads, q, width / heads)."""
        return features.unflatten(-1, (HEADS, -1)).transpose(1, 2)


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


def _positional_encoding(positions: Tensor, normals: Tensor) -> Tensor:
    """Return positions, normals, and octaves of sines and cosines of positions.

    The shape is (n, q, 3 (2 + 2 frequencies)).
    """
    octaves = 2.0 ** torch.arange(FREQUENCIES) * (math.pi / 2)
    phases = (positions[..., None] * octaves).flatten(-2)
    return torch.cat([positions, normals, phases.sin(), phases.cos()], dim=-1)


def _squares(points: Tensor, others: Tensor) -> Tensor:
    """Return squared distances between points, shape (n, a, b).

    They come from differences, to avoid cancellation.
    """
    return sum((points[:, :, None, k] - others[:, None, :, k]).square() for k in range(3))
