"""The depth network that learns canonical forms."""
