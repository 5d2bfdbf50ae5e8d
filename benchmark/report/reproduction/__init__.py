"""What of the paper's tables holds up: an outcome on each of its figures, and on each of its claims."""
