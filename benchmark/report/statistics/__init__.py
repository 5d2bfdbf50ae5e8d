"""Statistics of the figures of a table: intervals over classes, tests between rows."""
