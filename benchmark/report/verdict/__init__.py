"""What of the paper's tables holds up: a verdict on each of its figures, and on each of its claims."""
