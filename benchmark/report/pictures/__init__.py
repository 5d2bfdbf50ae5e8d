"""Pictures of meshes, depth images, data sets and canonical forms."""
