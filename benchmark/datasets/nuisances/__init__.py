"""Data sets whose shapes are disturbed on purpose: what a nuisance does to a mesh, at five strengths."""
