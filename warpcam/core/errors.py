"""Errors of the package."""


class WarpcamError(ValueError):
    """An argument that cannot be used: the message names it, what came and what is allowed."""


class RefusedError(WarpcamError):
    """A file of a scene lies outside of what the scene may open, or is larger than a limit.

    Readers that pass over a broken part with a warning do not pass over this.
    """


class OutOfMemoryError(WarpcamError):
    """A device has less memory free than is asked for. What was there before still works."""
