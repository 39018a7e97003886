"""Kernels of the simulation's state and forces."""
