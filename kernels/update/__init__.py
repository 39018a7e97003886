"""Kernels that change a scene between frames: refitting, skinning, poses, randomisation."""
