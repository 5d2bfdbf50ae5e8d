"""What a figure of a table is worth: intervals over classes, tests between rows."""
