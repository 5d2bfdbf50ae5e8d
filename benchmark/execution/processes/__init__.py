"""Processes of this machine: how they start, talk, and end with all that they started."""
