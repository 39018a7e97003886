"""Calls and types of gymapi."""
