"""Effects of depth cameras."""
