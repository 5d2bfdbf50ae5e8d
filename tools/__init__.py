"""Development tools: speed, faults, portability, golden results, bounds checks, documentation."""
