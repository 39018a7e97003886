"""Scenes: descriptions from sources, validation, bounds, lights and per-world overrides."""
