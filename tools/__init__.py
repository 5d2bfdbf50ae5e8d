"""Programs that developers run: speed, faults, portability, golden results, checked indices."""
