"""Score the results of other programs: distance matrices, and forms in mesh files."""
