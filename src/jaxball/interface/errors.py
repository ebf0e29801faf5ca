"""Errors in what the user typed."""


class UserError(ValueError):
    """What was typed, or written in a file, cannot be done; the message is one sentence that says what and why."""
