"""Scenes of Newton."""
