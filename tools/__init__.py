"""Programs that developers run: speed, faults, portability, studies, checked indices."""
