"""Extensions of surfaces and points that are known, so that their files are named, and have no format here."""

#: Meshes: a file of one is a shape that is refused, and counts as 0.
MESHES = (".3ds", ".3mf", ".dae", ".fbx", ".vtk", ".vtp", ".wrl")

#: Point clouds, which are skipped.
POINTS = (".pcd", ".pts", ".xyz")
