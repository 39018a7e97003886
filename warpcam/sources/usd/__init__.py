"""Scenes of USD stages."""
