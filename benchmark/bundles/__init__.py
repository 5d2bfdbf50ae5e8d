"""Bundles of results to share: packing, verification, and their rows in reports."""
