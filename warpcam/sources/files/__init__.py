"""Readers of mesh and splat files."""
