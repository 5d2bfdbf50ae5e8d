"""Meshes and what is measured on them: reading, preparation, geodesics, Laplacian, depth views."""
