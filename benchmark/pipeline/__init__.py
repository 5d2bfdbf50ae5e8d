"""From a shape to the record of a row: prepared shapes, forms, distances, scores; and where they are kept."""
