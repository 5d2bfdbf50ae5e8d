"""Data sets: official sets in their original layout, and generated stand-ins."""
