"""Terrain: height fields from triangle meshes."""
