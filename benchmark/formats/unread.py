"""Extensions of surfaces and points that have no format here, but whose files are named."""

#: Meshes: a file of one is a shape that is refused, and counts as 0.
UNREAD_MESHES = (".3ds", ".3mf", ".dae", ".fbx", ".vtk", ".vtp", ".wrl")

#: Point clouds, which are skipped.
UNREAD_POINTS = (".pcd", ".pts", ".xyz")
