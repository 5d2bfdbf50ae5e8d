"""Where the time of the workers of a run goes: ``python -m tools.profile run --all --quick``."""
