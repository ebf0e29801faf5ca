"""How a solve ended, with a sentence for each status, and what it could not know.

Here are also the bound within which a run under feedback has come back, and the warning that a user's function may jump
at times that no solve knows, which ``numerics.kinks`` gives.
"""

import enum
import functools
import warnings
from collections.abc import Callable
from typing import Any


class Status(enum.IntEnum):
    """How a solve ended, with a sentence for each way.

    **Example:**

    >>> from jaxball import Status
    >>> Status.LEFT_SHELL.sentence(reached=3.5, end=20.0)
    'The run to t = 20 is not valid after t = 3.5, where a mass left the shell.'
    """

    SUCCESS = 0
    MAX_STEPS = 1
    NOT_FINITE = 2
    IMPOSSIBLE = 3
    SOLVER_FAILED = 4
    LEFT_SHELL = 5
    DETACHED = 6
    SLIPPED = 7
    EVENT = 8
    JAMMED = 9
    CHATTERED = 10
    LEFT_SURFACE = 11
    WEDGED = 12
    TOPPLED = 13

    def sentence(self, reached: float, end: float, *, alone: bool = False) -> str:
        """Says what happened; the result is valid up to the time ``reached``.

        With ``alone``, the sentence for an impossible body says how to find out what is impossible about it.
        """
        sentence = _SENTENCES[self].format(reached=reached, end=end)
        return f"{sentence} {ADVICE}" if alone and self == Status.IMPOSSIBLE else sentence


# Of a run that reached its end, or an event that its user asked it to end at.
SUCCESSES = (Status.SUCCESS, Status.EVENT)
PENALTY = 1e3  # of exceeding a limit, in predictive control
BACK_WITHIN = 0.05  # of a deviation ξ at the end of a run under feedback: √(ξ·Q ξ / tr Q) of one that comes back
ADVICE = "jaxball.problems(system, state) says what is impossible about them."
_SENTENCES = {
    Status.SUCCESS: "The solve reached t = {end:.10g}.",
    Status.MAX_STEPS: (
        "The solve stopped at t = {reached:.10g} before t = {end:.10g}, because it had taken `max_steps` "
        "steps; raise `max_steps`, loosen the tolerances, or shorten the run."
    ),
    Status.NOT_FINITE: (
        "The solve stopped at t = {reached:.10g} before t = {end:.10g}, because the equations of motion are not finite "
        "there; check the schedules, rails and forces at that time, and dry friction, which may be too large for the "
        "normal force to have a solution (Painlevé's paradox)."
    ),
    Status.IMPOSSIBLE: "The solve did not start, because no body can have these parameters or this initial state.",
    Status.SOLVER_FAILED: (
        "The solve stopped at t = {reached:.10g} before t = {end:.10g}, because the solver could not take "
        "a step, for instance because an implicit equation did not converge; try another solver."
    ),
    Status.LEFT_SHELL: "The run to t = {end:.10g} is not valid after t = {reached:.10g}, where a mass left the shell.",
    Status.DETACHED: (
        "The run ended at t = {reached:.10g} before t = {end:.10g}, because the normal force was zero there: the body "
        "would leave the ground, and the equations of rolling do not hold after that."
    ),
    Status.SLIPPED: (
        "The run ended at t = {reached:.10g} before t = {end:.10g}, because rolling needed all the friction available: "
        "the body would slip, and the equations of rolling do not hold after that."
    ),
    Status.JAMMED: (
        "The run ended at t = {reached:.10g} before t = {end:.10g}, because friction is so large there that the normal "
        "force of a sliding body has no solution (Painlevé's paradox); lower the coefficient `friction`."
    ),
    Status.CHATTERED: (
        "The run ended at t = {reached:.10g} before t = {end:.10g}, because its mode switched over and over there in "
        "almost no time; with a law of contact, `static_friction` larger than `friction` may prevent this."
    ),
    Status.LEFT_SURFACE: (
        "The run ended at t = {reached:.10g} before t = {end:.10g}, because the body reached the edge of its ground "
        "there, or of the part that the coordinates on it reach, as where a height field is vertical; start it slower, "
        "or use a surface that reaches further, such as a Bowl, a Cylinder or a ParametricSurface."
    ),
    Status.WEDGED: (
        "The run ended at t = {reached:.10g} before t = {end:.10g}, because the ground bends towards the body as "
        "strongly as the body is curved there, so that it would touch the ground at a second point; make the body "
        "smaller or the ground smoother."
    ),
    Status.TOPPLED: (
        "The run ended at t = {reached:.10g} before t = {end:.10g}, because the body lies on its side there, and the "
        "equations of rolling on its rim do not hold after that; roll it faster, or end the run earlier."
    ),
    Status.EVENT: "The run ended at t = {reached:.10g} before t = {end:.10g}, where an event ended it.",
}


class SolveError(RuntimeError):
    """A solve failed, and the caller asked for an exception."""


# The warnings that were shown, each with the filters then. Python's own registry forgets them whenever any library
# enters `warnings.catch_warnings`, as JAX does while it traces.
_shown: set[Any] = set()


class KinkWarning(UserWarning):
    """A function may jump at times that a solve does not know, so that derivatives with respect to these are 0."""


def warn_of_kinks(function: Callable[..., Any], symbols: tuple[str, ...], remedy: str) -> None:
    """Warns that ``function`` compares the time by these operations, in a way that gives no times.

    The warning is shown at the first line of the function, and once while filters are the same unless one of them says
    "always".

    - ``remedy``: how its times are given.
    """
    while isinstance(function, functools.partial):
        function = function.func
    code = getattr(function, "__code__", None)
    name = getattr(function, "__qualname__", type(function).__qualname__).replace("<locals>.", "")
    by = ", ".join(f"`{symbol}`" for symbol in symbols)
    message = (
        f"{name} compares or rounds the time by {by}, so that it may jump at times that are not known. Steps do not "
        f"end there, and derivatives with respect to what moves a jump are 0. If it jumps, {remedy}; if a jump depends "
        "on the state, make it a mode of a hybrid system. If it does not jump, ignore "
        "jaxball.simulation.KinkWarning with warnings.filterwarnings."
    )
    file, line = ("<function>", 1) if code is None else (code.co_filename, code.co_firstlineno)
    warning = message, file, line, tuple(warnings.filters)
    always = any(action == "always" and issubclass(KinkWarning, kind) for action, _, kind, *_ in warnings.filters)
    if always or warning not in _shown:
        warnings.warn_explicit(message, KinkWarning, file, line, getattr(function, "__module__", None))
        _shown.add(warning)
