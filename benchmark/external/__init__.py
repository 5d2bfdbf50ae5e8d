"""Scores of what other programs computed: distance matrices, ranked lists, and forms in mesh files."""
