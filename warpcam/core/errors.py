"""The one kind of error."""


class WarpcamError(ValueError):
    """An argument that cannot be used: the message names it, what came and what is allowed."""
