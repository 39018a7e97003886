"""Scenes of MuJoCo and MuJoCo-Warp."""
