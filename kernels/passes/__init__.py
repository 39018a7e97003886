"""Passes of a frame: each module compiles its kernels and binds their arguments."""
