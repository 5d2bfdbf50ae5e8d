"""Plan the jobs of a selection, and run them in worker processes that may crash, hang or run out of memory."""
