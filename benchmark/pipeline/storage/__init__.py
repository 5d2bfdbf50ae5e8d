"""Keys that name a recipe, and the folder where results are kept by them."""
