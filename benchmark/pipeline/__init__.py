"""From a shape to the record of a row: prepared shapes, forms, distances and scores, and where they are kept."""
