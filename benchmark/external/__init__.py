"""Score the results of other programs: distance matrices, ranked lists, and forms in mesh files."""
