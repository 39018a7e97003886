"""Builders of acceleration structures."""
