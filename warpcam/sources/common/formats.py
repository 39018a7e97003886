"""Suffixes of the files that are read."""

USD = (".usd", ".usda", ".usdc", ".usdz")
MESHES = (".glb", ".gltf", ".dae", ".obj", ".stl", ".ply", ".msh")
MUJOCO = (".xml", ".mjb", ".urdf")
