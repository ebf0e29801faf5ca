"""A differentiable simulator of a ball, or a disk, that rolls without slipping and is driven by point
masses moving inside it, after Putkaradze & Rogers (2018).

A body (``Ball``, ``Disk``) holds point masses (``PointMass``), each with a motion (``OnRail``, ``Driven``, ``Fixed``,
``Free``, ``Oscillating``), and mechanisms (``Mechanism``) of joints (``Hinge``, ``Slider``, ``Carriage``) under forces
(``Motor``, ``Spring``); a ``Ground`` and a ``Resistance`` act on it. ``simulate`` takes a body and times to a
``Trajectory``. Names and packages are imported when they are first used. The packages are:

- ``chaos``, ``stability``: Lyapunov exponents, Poincaré maps; steady motions.
- ``control``: feedback that holds a motion: regulators, predictive control, which disturbed starts come back.
- ``estimation``: the state of a robot from what its sensors read, and how sure that is.
- ``environments``: robots in which policies are trained, with adapters to Gymnasium and Brax.
- ``classical``: the heavy top, Suslov's problem and other systems.
- ``design``, ``ensemble``, ``sweep``: designs by gradients, many runs side by side, studies.
- ``plot``, ``results``, ``scenario``, ``mjcf``, ``urdf``: figures, saved runs, scenario files, files of MuJoCo and ROS.
- ``sensors``: accelerometers, gyroscopes, encoders and cameras, read along a run, exactly or with errors.
- ``solvers``: implicit methods for diffrax.
- ``paper``, ``reproduce``, ``verify``: the paper's systems and figures, checks.
- ``cpu``, ``cache``: settings for fast solves on a CPU, compiled programs kept between processes.

The names of ``jaxball`` itself live in ``physics``, ``simulation``, ``numerics`` and ``interface``, and the commands in
``cli``, which need not be imported; ``CONTRIBUTING.md`` has a map of all packages.
"""

from .interface import starting

starting.end_without_traceback()  # before all other imports, so that a command shows none while they run

import importlib  # noqa: E402
import sys  # noqa: E402

__version__ = "0.1.0"

TYPE_CHECKING = False  # type checkers know the name; the module that has it takes as long to import as Python to start

if TYPE_CHECKING:  # for type checkers and editors, the same interface
    from . import (
        cache as cache,
        chaos as chaos,
        classical as classical,
        control as control,
        cpu as cpu,
        design as design,
        ensemble as ensemble,
        environments as environments,
        estimation as estimation,
        mjcf as mjcf,
        paper as paper,
        plot as plot,
        results as results,
        scenario as scenario,
        sensors as sensors,
        solvers as solvers,
        stability as stability,
        sweep as sweep,
        urdf as urdf,
        verify as verify,
    )
    from .interface.status import SolveError as SolveError, Status as Status
    from .interface.warning import KinkWarning as KinkWarning
    from .numerics.functions import HarmonicSeries as HarmonicSeries
    from .paper import reference as reference, reproduce as reproduce
    from .physics.body import (
        Ball as Ball,
        Disk as Disk,
        System as System,
        with_integrated_angles as with_integrated_angles,
        with_masses as with_masses,
    )
    from .physics.contact.history import ContactHistory as ContactHistory
    from .physics.contact.law import (
        AbstractFriction as AbstractFriction,
        Contact as Contact,
        LimitSurface as LimitSurface,
        SmoothedCoulomb as SmoothedCoulomb,
    )
    from .physics.contact.modes import Mode as Mode, SwitchCause as SwitchCause
    from .physics.contact.released import ReleasedState as ReleasedState
    from .physics.convex import ConvexBody as ConvexBody
    from .physics.dynamics.parameters import PointMass as PointMass
    from .physics.feedback import (
        AbstractLaw as AbstractLaw,
        FollowSchedules as FollowSchedules,
        FunctionLaw as FunctionLaw,
        LinearLaw as LinearLaw,
        Servo as Servo,
    )
    from .physics.forces.force import (
        AbstractForce as AbstractForce,
        AbstractWrench as AbstractWrench,
        BodyMotion as BodyMotion,
        FunctionForce as FunctionForce,
        FunctionWrench as FunctionWrench,
        HarmonicForce as HarmonicForce,
        Wrench as Wrench,
    )
    from .physics.forces.resistance import AbstractResistance as AbstractResistance, Resistance as Resistance
    from .physics.grounds import (
        AbstractSurface as AbstractSurface,
        Belt as Belt,
        Bowl as Bowl,
        Cylinder as Cylinder,
        HeightField as HeightField,
        MovingFrame as MovingFrame,
        Paraboloid as Paraboloid,
        ParametricSurface as ParametricSurface,
        SignedDistance as SignedDistance,
        SphereOutside as SphereOutside,
        TiltingPlane as TiltingPlane,
        Turn as Turn,
        Turntable as Turntable,
        Washboard as Washboard,
    )
    from .physics.grounds.ground import AbstractGround as AbstractGround, Ground as Ground
    from .physics.hybrid import Switches as Switches
    from .physics.mechanisms import (
        AbstractJoint as AbstractJoint,
        AbstractJointForce as AbstractJointForce,
        AbstractMechanism as AbstractMechanism,
        Accelerated as Accelerated,
        Carriage as Carriage,
        CarriedMass as CarriedMass,
        Damper as Damper,
        EndStops as EndStops,
        FunctionJointForce as FunctionJointForce,
        FunctionMechanism as FunctionMechanism,
        HardStops as HardStops,
        Hinge as Hinge,
        JointForces as JointForces,
        JointFriction as JointFriction,
        MajdSimaanFriction as MajdSimaanFriction,
        Mechanism as Mechanism,
        Motor as Motor,
        PDServo as PDServo,
        Slider as Slider,
        SpeedLimitedMotor as SpeedLimitedMotor,
        Spring as Spring,
        double_pendulum as double_pendulum,
        gyroscopic_pendulum as gyroscopic_pendulum,
        mass_in_tube as mass_in_tube,
        planar_pendulum as planar_pendulum,
        rigid_body_masses as rigid_body_masses,
        ring_rotor as ring_rotor,
        spherical_pendulum as spherical_pendulum,
        turning_rail as turning_rail,
    )
    from .physics.observables import Observables as Observables, observe as observe
    from .physics.own_states import OwnStates as OwnStates, odometer as odometer
    from .physics.prescribed.frames import (
        AbstractFrame as AbstractFrame,
        MatrixFrame as MatrixFrame,
        SphericalFrame as SphericalFrame,
        VersorFrame as VersorFrame,
    )
    from .physics.prescribed.motion import (
        Driven as Driven,
        Fixed as Fixed,
        Free as Free,
        OnRail as OnRail,
        Oscillating as Oscillating,
    )
    from .physics.prescribed.rails import (
        AbstractRail as AbstractRail,
        BernoulliEight as BernoulliEight,
        Circle as Circle,
        Ellipse as Ellipse,
        FourierRail as FourierRail,
        FunctionRail as FunctionRail,
        GeronoEight as GeronoEight,
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
    from .physics.prescribed.signals import (
        AbstractIntegrableSignal as AbstractIntegrableSignal,
        AbstractSignal as AbstractSignal,
        ConstantSignal as ConstantSignal,
        PiecewiseSignal as PiecewiseSignal,
    )
    from .physics.rolling import AbstractRollingSystem as AbstractRollingSystem, Reaction as Reaction
    from .physics.shape import (
        AbstractShape as AbstractShape,
        Ellipsoid as Ellipsoid,
        SupportFunction as SupportFunction,
    )
    from .physics.state import (
        BallState as BallState,
        DiskState as DiskState,
        ReducedState as ReducedState,
        RotationState as RotationState,
        State as State,
    )
    from .physics.system import (
        AbstractState as AbstractState,
        AbstractSystem as AbstractSystem,
        vector_field as vector_field,
    )
    from .physics.validity import problems as problems
    from .programs.native import compiler as compiler
    from .programs.users_functions import jit as jit
    from .results import load_run as load_run, save as save, to_dataset as to_dataset
    from .scenario import (
        LogError as LogError,
        Scenario as Scenario,
        ScenarioError as ScenarioError,
        load_log as load_log,
        load_scenario as load_scenario,
        read_scenario as read_scenario,
        write_scenario as write_scenario,
    )
    from .simulation.arguments import PrecisionError as PrecisionError
    from .simulation.equilibrium import Balance as Balance, balance as balance, with_angles as with_angles
    from .simulation.errors_of_results import estimate_error_of as estimate_error_of
    from .simulation.events import (
        AbstractEvent as AbstractEvent,
        Detachment as Detachment,
        Event as Event,
        Occurrences as Occurrences,
        Slip as Slip,
    )
    from .simulation.extremes import ContactExtremes as ContactExtremes, contact_extremes as contact_extremes
    from .simulation.global_error import estimate_error as estimate_error
    from .simulation.losses import EnergyLosses as EnergyLosses, energy_losses as energy_losses
    from .simulation.simulate import simulate as simulate
    from .simulation.trajectory import Trajectory as Trajectory
else:
    from . import methods  # noqa: F401 - which provides those of a trajectory
    from .interface.names import imports_of, lazy_interface, missing

    _MODULES = imports_of(__name__)
    _PACKAGES = {name: f"{module}.{name}".strip(".") for name, module in _MODULES.items() if module in (".", ".paper")}
    _NAMES = {name: module for name, module in _MODULES.items() if name not in _PACKAGES}
    __all__, __dir__, _load = lazy_interface(__name__, _NAMES, *_PACKAGES, "__version__")

    def __getattr__(name: str) -> object:
        """Returns a public name or package of jaxball, or one of its internal packages, which ``dir`` does not show."""
        if name in __all__:
            return _load(name)
        module = f"{__name__}.{_PACKAGES.get(name, name)}"
        try:
            return globals().setdefault(name, importlib.import_module(module))
        except ModuleNotFoundError as error:
            if error.name != module:
                raise
        raise missing(__name__, name)

    if "jax" in sys.modules:  # else they are added where JAX is first needed
        importlib.import_module(".programs.traces", __name__)
