"""Feedback that holds a motion: regulators along it, closed loops with sampled inputs, which starts come back.

``tvlqr`` linearises the flow of a simulated motion from sample to sample, and gives the feedback with the least
quadratic cost; ``mpc`` foresees limits of motors and of friction as well. ``closed_loop`` simulates the robot under
either, and ``basin`` many disturbed starts. The motions themselves
may be found by :mod:`jaxball.design.optimal_control`, by collocation and without feedback. No figures and no files:
:mod:`jaxball.plot` draws the results.
"""

TYPE_CHECKING = False

if TYPE_CHECKING:  # for type checkers and editors, the same interface
    from ..physics.forces.force import Push as Push
    from .basins import Basin as Basin, basin as basin
    from .feedback import (
        AbstractFeedback as AbstractFeedback,
        Feedforward as Feedforward,
        NominalMotion as NominalMotion,
    )
    from .history import FeedbackHistory as FeedbackHistory
    from .loop import ClosedLoop as ClosedLoop, closed_loop as closed_loop
    from .prediction import PredictiveControl as PredictiveControl, mpc as mpc
    from .sampled import Linear as Linear, SampledSystem as SampledSystem
    from .track import Track as Track, tvlqr as tvlqr
else:
    from ..interface.names import lazy_interface

    __all__, __dir__, __getattr__ = lazy_interface(__name__)
