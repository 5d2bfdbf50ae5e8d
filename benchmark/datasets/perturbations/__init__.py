"""Data sets whose shapes are perturbed on purpose: what a perturbation does to a mesh, at five strengths."""
