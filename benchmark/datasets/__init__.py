"""Data sets: official ones read as they come, and generated stand-ins."""
