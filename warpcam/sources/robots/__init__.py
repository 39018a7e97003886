"""URDF files: what they name, for every simulator that reads them."""
