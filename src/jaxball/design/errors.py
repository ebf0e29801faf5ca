"""What can be wrong with a design problem."""

from ..scenario import ScenarioError


class DesignError(ScenarioError):
    """A design problem cannot be posed, or cannot be resumed; the message is one sentence that says which."""
