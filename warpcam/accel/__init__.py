"""Host-side building of what the kernels read: mesh trees, height pyramids, packed textures."""
