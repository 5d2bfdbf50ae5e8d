"""Data sets with perturbed shapes: perturbations of meshes and views at five strengths."""
