"""Effects of time: when frames are taken and delivered, and what moves while they are exposed."""
