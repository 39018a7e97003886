"""Parts that several sources share: geometry, materials, images, scene graphs."""
