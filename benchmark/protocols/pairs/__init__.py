"""Pairs that learners are trained on: shapes of a protocol beside their canonical poses, as every method sees them."""

from benchmark.protocols.pairs.protocol import training_data

__all__ = ["training_data"]
