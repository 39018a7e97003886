"""Kernels of Newton's deformables."""
