"""Golden results: what each component of the suite makes of a few committed inputs."""
