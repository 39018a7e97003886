"""Effects of colour cameras."""
