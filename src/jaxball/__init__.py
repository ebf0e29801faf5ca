"""A differentiable simulator of a ball, or a disk, that rolls without slipping and is driven by point
masses moving inside it, after Putkaradze & Rogers (2018).

A body (``Ball``, ``Disk``) holds point masses (``PointMass``), each with a motion (``OnRail``, ``Driven``, ``Fixed``,
``Free``, ``Oscillating``), and mechanisms (``Mechanism``) of joints (``Hinge``, ``Slider``, ``Carriage``) under forces
(``Motor``, ``Spring``); a ``Ground`` and a ``Resistance`` act on it. ``simulate`` takes a body and times to a
``Trajectory``. What most need is here; the rest, by subject, is in these packages. All is imported when it is first
used.

- ``physics``: further rails, grounds, joints, forces, states, and the contracts of what users write themselves;
  ``physics.sensors``, and ``physics.classical``: the heavy top, Suslov's problem and other systems.
- ``simulation``: what is asked of a run; ``simulation.solvers``, implicit methods for diffrax; ``simulation.ensemble``,
  many runs side by side.
- ``analysis``: ``chaos``, ``stability``, and ``verify``, the laws that a run must obey.
- ``control``: feedback that holds a motion; ``control.estimation``, the state of a robot from what its sensors read;
  ``control.environments``, robots in which policies are trained.
- ``studies``: ``sweep``, one scenario with many sets of parameters; ``design``, the best parameters, by gradients.
- ``files``: ``scenario``, ``results``, ``mjcf`` and ``urdf``.
- ``plot``: figures, animations and views.
- ``paper``: the paper's systems, their 30-digit solutions, and its figures reproduced.
- ``programs.cpu``, ``programs.cache``: settings for fast solves on a CPU, compiled programs kept between processes.

``CONTRIBUTING.md`` has a map of all packages.
"""

from .interface import starting

starting.end_without_traceback()  # before all other imports, so that a command shows none while they run

import importlib  # noqa: E402
import sys  # noqa: E402

__version__ = "0.1.0"

TYPE_CHECKING = False  # type checkers know the name; the module that has it takes as long to import as Python to start

if TYPE_CHECKING:  # for type checkers and editors, the same interface
    from . import (
        analysis as analysis,
        control as control,
        files as files,
        paper as paper,
        physics as physics,
        plot as plot,
        programs as programs,
        simulation as simulation,
        studies as studies,
    )
    from .files.results.loading import load_run as load_run
    from .files.results.saving import save as save
    from .files.scenario.errors import ScenarioError as ScenarioError
    from .files.scenario.files import (
        load_scenario as load_scenario,
        read_scenario as read_scenario,
        write_scenario as write_scenario,
    )
    from .files.scenario.scenario import Scenario as Scenario
    from .interface.status import SolveError as SolveError, Status as Status
    from .numerics.functions import HarmonicSeries as HarmonicSeries
    from .physics.body import Ball as Ball, Disk as Disk
    from .physics.contact.law import Contact as Contact
    from .physics.convex import ConvexBody as ConvexBody
    from .physics.dynamics.parameters import PointMass as PointMass
    from .physics.feedback import (
        AbstractLaw as AbstractLaw,
        FollowSchedules as FollowSchedules,
        FunctionLaw as FunctionLaw,
        LinearLaw as LinearLaw,
        Servo as Servo,
    )
    from .physics.forces.force import FunctionForce as FunctionForce, FunctionWrench as FunctionWrench, Wrench as Wrench
    from .physics.forces.resistance import Resistance as Resistance
    from .physics.grounds import Belt as Belt, Bowl as Bowl, HeightField as HeightField, Turntable as Turntable
    from .physics.grounds.ground import AbstractGround as AbstractGround, Ground as Ground
    from .physics.mechanisms import (
        Accelerated as Accelerated,
        Carriage as Carriage,
        CarriedMass as CarriedMass,
        Damper as Damper,
        EndStops as EndStops,
        HardStops as HardStops,
        Hinge as Hinge,
        JointFriction as JointFriction,
        Mechanism as Mechanism,
        Motor as Motor,
        PDServo as PDServo,
        Slider as Slider,
        Spring as Spring,
        planar_pendulum as planar_pendulum,
        rigid_body_masses as rigid_body_masses,
        ring_rotor as ring_rotor,
        spherical_pendulum as spherical_pendulum,
    )
    from .physics.observables import observe as observe
    from .physics.prescribed.frames import MatrixFrame as MatrixFrame, SphericalFrame as SphericalFrame
    from .physics.prescribed.motion import (
        Driven as Driven,
        Fixed as Fixed,
        Free as Free,
        OnRail as OnRail,
        Oscillating as Oscillating,
    )
    from .physics.prescribed.rails import (
        AbstractRail as AbstractRail,
        Circle as Circle,
        Ellipse as Ellipse,
        FourierRail as FourierRail,
        FunctionRail as FunctionRail,
        SplineRail as SplineRail,
        Tube as Tube,
    )
    from .physics.prescribed.recorded import RecordedSchedule as RecordedSchedule, RecordedSignal as RecordedSignal
    from .physics.prescribed.schedules import (
        AbstractSchedule as AbstractSchedule,
        ConstantRate as ConstantRate,
        FunctionSchedule as FunctionSchedule,
        PiecewiseAcceleration as PiecewiseAcceleration,
        Pulse as Pulse,
        Sinusoids as Sinusoids,
        Waypoints as Waypoints,
    )
    from .physics.prescribed.signals import PiecewiseSignal as PiecewiseSignal
    from .physics.state import BallState as BallState, DiskState as DiskState
    from .physics.system import AbstractSystem as AbstractSystem
    from .physics.validity import problems as problems
    from .programs.native import compiler as compiler
    from .programs.users_functions import jit as jit
    from .simulation.equilibrium import balance as balance
    from .simulation.events import Detachment as Detachment, Event as Event, Slip as Slip
    from .simulation.extremes import contact_extremes as contact_extremes
    from .simulation.simulate import simulate as simulate
    from .simulation.trajectory import Trajectory as Trajectory
else:
    from .interface.names import lazy_interface

    __all__, __dir__, __getattr__ = lazy_interface(__name__, "__version__")

    if "jax" in sys.modules:  # else they are added where JAX is first needed
        importlib.import_module(".programs.traces", __name__)
