"""Keys of recipes, and the folder that stores results by key."""
