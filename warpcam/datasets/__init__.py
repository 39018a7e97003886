"""Data sets: labelled images in bulk."""
