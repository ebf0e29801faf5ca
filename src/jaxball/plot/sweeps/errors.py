"""What cannot be drawn."""


class PictureError(ValueError):
    """A study cannot be drawn as asked; the message is one sentence."""
