"""Stereo cameras that match two infrared images."""
