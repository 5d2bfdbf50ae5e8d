"""Plan the jobs of a selection, and run them in worker processes, which may crash or hang."""
