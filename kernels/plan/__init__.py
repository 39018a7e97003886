"""Choice of kernels: each module turns scene, camera, outputs and device into the frozen keys of one kind of kernel.

Passes compile the kernel of a key and bind arrays to it; they choose nothing. Rules that depend on the device alone are
in launches.py.
"""
