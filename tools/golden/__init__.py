"""Golden results: the output of each component of the suite for a few committed inputs."""
