"""The rolling body at one time, as a picture: a frame of its animation."""

import numpy as np
from matplotlib.figure import Figure

from ..numerics.arrays import Numbers
from ..simulation.trajectory import Trajectory
from .record import record_to_show
from .scene import scene


def snapshot(trajectory: Trajectory, t: Numbers | None = None) -> Figure:
    """The body on its plane, or above it, at one time, with the trail of the contact point up to then.

    **Arguments:**

    - ``trajectory``: what :func:`jaxball.simulate` returns.
    - ``t``: the time, for which the nearest saved one is shown; by default the last one that the solve reached.

    **Raises:** ``ValueError`` for a trajectory without a finite state, and for a reduced one or a batch.

    **Example:**

    >>> import jax
    >>> jax.config.update("jax_enable_x64", True)
    >>> from jaxball import Disk, DiskState, plot, simulate
    >>> run = simulate(Disk(mass=1.0, inertia=0.5), [0.0, 1.0, 2.0], DiskState(phidot=-1.0))
    >>> plot.snapshot(run, 1.0).savefig("disk.png")
    >>> print([round(float(place), 3) for place in run.state.z])
    [0.0, 1.0, 2.0]
    """
    run = record_to_show(trajectory)
    figure, show = scene(trajectory, run)
    show(len(run.times) - 1 if t is None else int(np.argmin(np.abs(run.times - float(np.asarray(t))))))
    return figure
