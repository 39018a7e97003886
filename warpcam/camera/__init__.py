"""Cameras, lenses and the outputs that a camera can be asked for."""
