"""Feedback that holds a motion: regulators along it, closed loops with sampled inputs, which starts come back.

``tvlqr`` linearises the flow of a simulated motion from sample to sample, and gives the feedback with the least
quadratic cost; its ``mpc`` foresees limits of motors and of friction as well. ``closed_loop`` of either simulates the
robot, and ``basin`` many disturbed starts. The motions themselves may be found by
:mod:`jaxball.studies.design.optimal_control`, by collocation and without feedback. No figures and no files:
:mod:`jaxball.plot` draws the results.
"""

TYPE_CHECKING = False

if TYPE_CHECKING:  # for type checkers and editors, the same interface
    from ..physics.forces.force import Push as Push
    from . import environments as environments, estimation as estimation
    from .feedback import (
        AbstractFeedback as AbstractFeedback,
        NominalMotion as NominalMotion,
    )
    from .track import tvlqr as tvlqr
else:
    from ..interface.names import lazy_interface

    __all__, __dir__, __getattr__ = lazy_interface(__name__)
