"""The suite from Python: arrays in, a canonical form out."""

from benchmark.api.depth_forms import canonical_form_of_depth

__all__ = ["canonical_form_of_depth"]
