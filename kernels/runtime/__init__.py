"""Compilation, launches, streams and graphs of kernels."""
