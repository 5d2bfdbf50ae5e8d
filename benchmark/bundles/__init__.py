"""Bundles: results that somebody passes on, what of them can be shown to be so, and the page of all of them."""
