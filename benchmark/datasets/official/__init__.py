"""Official data sets in their published layouts."""
