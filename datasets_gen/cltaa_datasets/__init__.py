"""Scenes as functions of time, each declaring the effects it calls for."""

# Which model files can be shown, and how: apart from what reads them, so that the command line can tell at once.
MOTIONS = ("turntable", "orbit", "play")
GLTF = (".glb", ".gltf")
FORMATS = (*GLTF, ".obj", ".ply", ".stl")
