"""Scenes as functions of time, each with its declared effects."""

# Supported model files and motions, separate from their readers so that the command line can list them quickly.
MOTIONS = ("turntable", "orbit", "play")
GLTF = (".glb", ".gltf")
FORMATS = (*GLTF, ".obj", ".ply", ".stl")
