"""Front ends in other systems' words, over the same scenes and renderers. Each is imported by its own name."""
