"""The errors of design problems."""

from ..scenario import ScenarioError


class DesignError(ScenarioError):
    """A design problem cannot be posed, or cannot be resumed; the message is one sentence that says which."""
