"""What can be done with a run by what is built upon it: errors and losses, data sets and files, figures and views.

A user who has a trajectory looks there for it.
"""

import os
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal, overload

from ..interface.names import leave_to
from ..numerics.arrays import Numbers
from ..physics.sensors import AbstractSensor

if TYPE_CHECKING:
    import pathlib

    import matplotlib.axes
    import matplotlib.figure
    import xarray

    from ..files.scenario.scenario import Scenario
    from ..plot.animation import Animation
    from ..plot.record import Picture
    from ..plot.view.page import View
    from .losses import EnergyLosses

Panel = Literal[
    "acceleration",
    "mass_angles",
    "configuration",
    "body_paths",
    "space_paths",
    "attitude",
    "angular_velocity",
    "centre_path",
    "centre_velocity",
    "energies",
    "power",
    "contact_force",
    "friction_ratio",
    "joint_angles",
    "joint_efforts",
    "height",
    "slip_speed",
    "own_states",
]


class TrajectoryMethods:
    """The methods of a trajectory that other modules have."""

    @leave_to(".global_error:estimate_error")
    def error_estimate(self, of: Callable[..., Any] | None = None) -> Any:
        """Estimates the global error of a run, or of a result computed from it: the computed value less the true one.

        From each saved state the motion is solved to the next saved time at a tolerance of 1e-14. The saved state there
        differs by a local error eₖ, and the tangent Jₖ of that solve carries the errors of all earlier intervals on,
        εₖ₊₁ = Jₖ εₖ + eₖ. For a functional of the run this is Σ λₖᵀ eₖ, with λ from the adjoint equations (D. Estep,
        SIAM Journal on Numerical Analysis 32, 1995; Y. Cao & L. Petzold, SIAM Journal on Scientific Computing 26,
        2004). Carried forward, as R. D. Skeel describes (Numerische Mathematik 48, 1986), it is known for all
        functionals at once.

        The run must be one in float64, also as read by :func:`jaxball.load_run`; it may roll, slip, fly and stick. The
        estimate needs nothing of how it was solved. It is right to first order in the errors, as long as these are
        small against the motion, and resolves errors of about 1e-13 in each interval.

        **Arguments:**

        - ``of``: a function of a run to numbers, arrays or a pytree of these, such as ``lambda run: run.state.z[-1,
          0]``. It is called with the run and with one whose states are free of the estimated error, need not be
          differentiable, and may read what follows from the states at the saved times, as ``run.observables`` does. If
          not given, the state.

        **Returns:** what ``of`` returns, with the error of each number in its place, in its unit. By default a state,
        with the errors of its components at the saved times, which are the leading axis. NaN at times that the run did
        not reach.

        **Raises:** ``TypeError`` for an ``of`` that is no function or does not return numbers; ``ValueError`` for a
        batch, in a function that JAX transforms, for a run under feedback, for one that did not come to its second
        saved time, where ``of`` reads dense output, events, switches or losses, and where the form of its result
        depends on the states; :class:`PrecisionError` in float32; and :class:`~jaxball.SolveError` where a solve
        between two times fails.

        **Example:**

        >>> import jax
        >>> jax.config.update("jax_enable_x64", True)
        >>> from jaxball import Disk, DiskState, simulate
        >>> slope = Disk(mass=1.0, inertia=0.5, offset=(0.0, 0.0, -0.2))  # it rocks to and fro
        >>> run = simulate(slope, [0.0, 5.0, 10.0], DiskState(phidot=-0.5), rtol=1e-6, atol=1e-6)
        >>> error = run.error_estimate(lambda run: run.state.z[-1])
        >>> finer = simulate(slope, [0.0, 5.0, 10.0], DiskState(phidot=-0.5), rtol=1e-13, atol=1e-13)
        >>> bool(abs(error / (run.state.z[-1] - finer.state.z[-1]) - 1) < 1e-3)
        True
        """
        raise NotImplementedError

    @leave_to(".losses")
    def energy_losses(self) -> "EnergyLosses":
        """Computes the energies that contact, resistance and joints have dissipated since the start of a run of a ball
        or a disk with ``dense=True``.

        The energy of a body that nothing drives falls by their ``total``. What dry friction holds loses nothing. They
        are integrals over the dense output, as exact as that, and differentiable.

        **Raises:** ``TypeError`` for another system, and ``ValueError`` without dense output and for a batch.

        **Example:**

        >>> import jax.numpy as jnp
        >>> from jaxball import Disk, DiskState, Resistance, simulate
        >>> disk = Disk(mass=1.0, inertia=0.5, resistance=Resistance(dry=0.01, exact=True))
        >>> run = simulate(disk, [0.0, 200.0, 400.0], DiskState(phidot=-1.0), dense=True)
        >>> run.energy_losses().dry.round(6)  # ½ (m r² + d2) φ̇², all that it had
        Array([0.  , 0.75, 0.75], dtype=float64)
        """
        raise NotImplementedError

    @leave_to("..files.results.saving")
    def to_dataset(
        self, scenario: "Scenario | None" = None, sensors: Mapping[str, AbstractSensor] | None = None
    ) -> "xarray.Dataset":
        """Converts the run and all its observables, or the laws of a classical system, to an ``xarray.Dataset``.

        Dimensions are ``time``; ``mass``; ``joint``, by name, as in ``mechanisms[0].joints[1]``; ``driven``, the masses
        whose angles belong to the state, by their numbers, or by name where joints are among them; ``own_state``, the
        states of one's own, by name, with the coordinate ``own_unit`` where they state units; and of vectors ``axis``,
        ``direction`` in the plane and ``component`` of a versor. All are counted from 0. Attributes say how the solve
        ended, and hold the scenario's file. A run with a law of contact, exact dry resistance, or joints that stick or
        have stops, has its modes too, and its switches between them along ``switch``. The times of an event are
        ``event_…_times``, with its name. One under feedback has the motion that it holds (``nominal_…``), its
        ``inputs`` and ``deviation``, and what was estimated (``estimate_…``).

        **Arguments:**

        - ``scenario``: the scenario of the run; by default the one that was run. If there is none, a scenario of the
          system, its initial state and the times is saved, if a file can hold them.
        - ``sensors``: those of :mod:`jaxball.physics.sensors` whose readings are included, each under its name after
          ``measured_``; by default those of the scenario.

        **Raises:** ``ValueError`` for a batch of trajectories, and where the body lacks the part that a sensor is on.

        **Example:**

        >>> from jaxball import Disk, DiskState, simulate
        >>> run = simulate(Disk(mass=1.0, inertia=0.5), [0.0, 1.0, 2.0], DiskState(phidot=-1.0))
        >>> run.to_dataset().normal_force.values
        array([1., 1., 1.])
        """
        raise NotImplementedError

    @leave_to("..files.results.saving")
    def save(
        self,
        path: "str | os.PathLike[str]",
        scenario: "Scenario | None" = None,
        sensors: Mapping[str, AbstractSensor] | None = None,
    ) -> "pathlib.Path":
        """Saves the run as ``.nc``, ``.npz``, ``.csv`` or ``.mcap``; see :func:`jaxball.save`.

        :func:`jaxball.load_run` reads the first two back. The file has the scenario that was simulated, with its
        settings, or another ``scenario``.
        """
        raise NotImplementedError

    @overload
    def plot(self, panel: None = None, ax: None = None, *, title: str = "") -> "matplotlib.figure.Figure": ...

    @overload
    def plot(self, panel: Panel, ax: "matplotlib.axes.Axes | None" = None) -> "matplotlib.axes.Axes": ...

    @leave_to("..plot.report:draw")
    def plot(
        self, panel: Panel | None = None, ax: "matplotlib.axes.Axes | None" = None, *, title: str = ""
    ) -> "matplotlib.figure.Figure | matplotlib.axes.Axes":
        """Draws the run on one page, and returns the figure; or one ``panel`` of it, and returns its axes.

        The page of a ball or a disk has configuration, trajectories, path, angular velocity, energies and friction,
        under a ``title``, by default that of the scenario. For a body without masses or mechanisms, the velocity takes
        the place of the configuration and the trajectories. A run with a law of contact that slips or flies has an
        additional row, with its height, its slip speed and its forces; so have states of one's own. Of a system with a
        Lagrangian, the coordinates are drawn, and of other systems the motion.

        **Arguments:**

        - ``panel``: of a ball or a disk. Over time: the ``"acceleration"`` of masses on rails, ``"mass_angles"``,
          ``"joint_angles"`` and ``"joint_efforts"``, the ``"attitude"``, the ``"angular_velocity"``, the
          ``"centre_velocity"``, ``"energies"``, the ``"power"`` of all that does work, the ``"contact_force"``, the
          ``"friction_ratio"`` |f| / N, ``"own_states"``, and with a law of contact the ``"height"`` and the
          ``"slip_speed"``. In space: the ``"configuration"`` at t = 0, the paths of the masses in axes of the body,
          ``"body_paths"``, and of space, ``"space_paths"``, and the ``"centre_path"``.
        - ``ax``: where to draw a panel; by default in a new figure, which is ``ax.figure``, with a caption.

        **Raises:** ``ValueError`` for a reduced trajectory or a batch, for an unknown panel, for one of what the body
        lacks, and for axes in the plane where it needs three dimensions, or the other way round.
        """
        raise NotImplementedError

    @leave_to("..plot.report:save_figures_of")
    def save_figures(
        self,
        folder: "str | pathlib.Path",
        title: str = "",
        *,
        name: str = "",
        formats: Sequence[str] = ("png",),
        sensors: Mapping[str, AbstractSensor] | None = None,
        svg_text: bool = False,
        replace: bool = False,
    ) -> "list[pathlib.Path]":
        """Writes the standard figures into ``folder``, and returns their paths.

        Each file is named after the scenario and the panel, as in ``six-tubes_energies.png``, and written in each
        format. Empty figures are left out: accelerations and angles if no mass has one, and the paths in a body without
        any mass except its homogeneous shell. A run with a law of contact also has its height and its slip speed,
        unless they are always zero, and states of one's own are drawn. For a classical system, the motion and its
        conserved quantities are.

        Each file records its run. Figures of the same run are replaced; those of another run are not.

        **Arguments:**

        - ``folder``: where to write; it is created if it does not exist.
        - ``title``: a line that says which system it is, such as that of a scenario.
        - ``name``: the prefix of the file names; by default the kind of the system, such as ``ball``.
        - ``formats``: png, pdf or svg.
        - ``sensors``: those of :mod:`jaxball.physics.sensors`, by name, whose readings are drawn too.
        - ``svg_text``: whether SVG keeps text as text, which can be edited but needs the fonts, instead of outlines.
        - ``replace``: whether to replace files that are not figures of this run.

        **Raises:** ``ValueError`` for a reduced trajectory or a batch; :class:`~jaxball.files.results.OutputError`
        where there is a file that is not a figure of this run; nothing is written then.
        """
        raise NotImplementedError

    @leave_to("..plot.animation")
    def snapshot(self, t: Numbers | None = None, *, picture: "Picture | None" = None) -> "matplotlib.figure.Figure":
        """Draws the body on its ground, or above it, at one time, with the trail of the contact point up to then.

        **Arguments:**

        - ``t``: the time, for which the nearest saved one is shown; by default the last one that the solve reached.
        - ``picture``: as for :meth:`animate`.

        **Raises:** ``ValueError`` for a trajectory without a finite state, and for a reduced one or a batch.

        **Example:**

        >>> import jax
        >>> jax.config.update("jax_enable_x64", True)
        >>> from jaxball import Disk, DiskState, simulate
        >>> run = simulate(Disk(mass=1.0, inertia=0.5), [0.0, 1.0, 2.0], DiskState(phidot=-1.0))
        >>> run.snapshot(1.0).savefig("disk.png")
        >>> print([round(float(place), 3) for place in run.state.z])
        [0.0, 1.0, 2.0]
        """
        raise NotImplementedError

    @leave_to("..plot.animation")
    def animate(
        self,
        path: "str | pathlib.Path | None" = None,
        fps: int | None = None,
        *,
        speed: float = 1.0,
        dpi: float | int = 120,
        size: tuple[int, int] | None = None,
        picture: "Picture | None" = None,
        progress: Callable[[int, int], Any] | None = None,
    ) -> "Animation":
        """Animates the rolling body: shell, rails, masses, centre of mass and the trail of the contact point.

        Gravity points down, so that a tilted plane is the top of a wedge. A moving plane carries floor and trail along,
        and a turntable turns; the trail is in axes that move with the plane but do not turn. A surface is a mesh, with
        the trail on the pieces of it that the ball has touched. For a run with a law of contact, the trail is that of
        the lowest point, dashed where the body slides and dotted where it flies above its shadow.

        Each frame shows the nearest saved time of those with a finite state, so save at least ``fps / speed`` times per
        unit of time for a smooth animation.

        **Arguments:**

        - ``path``: a file that ends in ``.mp4``, which needs ffmpeg, or in ``.gif``. Without a suffix,
          ``.mp4`` is added where ffmpeg is installed, and ``.gif`` otherwise. Nothing is written if not given.
        - ``fps``: frames per second; if not given, 30 in an MP4 and 20 in a GIF.
        - ``speed``: units of the trajectory's time per second of the animation.
        - ``dpi``: dots per inch; a frame is 8 inches wide.
        - ``size``: width and height of a frame in pixels, instead of ``dpi``; the scene is scaled to fit.
        - ``picture``: for a system with a Lagrangian, a function of (t, q) that draws it: a list of points and lines,
          each an array of shape (points, 2) or (points, 3).
        - ``progress``: called with the number of frames done and the number of all, after each frame.

        **Returns:** an :class:`~jaxball.plot.animation.Animation`, which a notebook plays, and which has a method
        ``save(path)``. A file is written when all frames have been drawn; nothing is written if that fails.

        **Raises:** ``ValueError`` for another suffix, for ``.mp4`` without ffmpeg, for an ``fps`` or a
        ``speed`` that is not positive, for a trajectory without a finite state, and for a reduced one or a batch.
        """
        raise NotImplementedError

    @leave_to("..plot.view.page:view_run")
    def view(
        self,
        path: "str | os.PathLike[str] | None" = None,
        *,
        title: str | None = None,
        friction: float | None = None,
        picture: "Picture | None" = None,
        all_times: bool = False,
    ) -> "View":
        """Shows the run as a page: the body in three dimensions, and graphs over time, which a notebook shows in place.

        ``run.view().save("run.html")`` or ``run.view("run.html")`` writes it as one file that opens in any browser,
        without a network; ``run.view().html`` is its text. Each frame shows the nearest saved time.

        ``path``, ``title``, ``friction``, ``picture``, ``all_times`` and what is raised: as for
        :func:`jaxball.plot.write_view`. The title is that of the scenario, if there is one, unless it is given.
        """
        raise NotImplementedError
