"""Kernels of MuJoCo's visual geoms."""
