"""Textures packed for the device."""
