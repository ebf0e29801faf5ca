"""The errors that are for whoever typed something."""


class UserError(ValueError):
    """What was typed, or written into a file, cannot be done; the message is one sentence that says what and why."""
