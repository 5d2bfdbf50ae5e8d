"""What breaks which method: curves from records, and how they are written."""
