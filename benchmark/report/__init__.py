"""Tables and figures from records; nothing here computes a result."""
