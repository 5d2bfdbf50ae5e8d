"""Triangle meshes: reading, preparation, geodesics, Laplacian, depth views."""
