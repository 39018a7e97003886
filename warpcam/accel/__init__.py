"""Host-side building of what the kernels read: mesh trees, cells and peaks of terrain, packed textures."""
