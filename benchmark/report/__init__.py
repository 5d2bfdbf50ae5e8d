"""From records to tables and figures; nothing here computes a result."""
