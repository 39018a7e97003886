"""Simulation by MuJoCo-Warp behind Isaac Gym's calls."""
