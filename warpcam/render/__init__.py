"""The renderer: passes of each camera, memory, and the history that optical flow needs."""
