"""A differentiable simulator of a ball, or a disk, that rolls without slipping and is driven by point
masses moving inside it, after Putkaradze & Rogers (2018).
"""

from .body import (
    Ball as Ball,
    Disk as Disk,
    PointMass as PointMass,
    System as System,
    with_integrated_angles as with_integrated_angles,
    with_masses as with_masses,
)
from .dynamics import vector_field as vector_field
from .equilibrium import Balance as Balance, balance as balance, with_angles as with_angles
from .events import (
    AbstractEvent as AbstractEvent,
    Detachment as Detachment,
    Event as Event,
    Slip as Slip,
)
from .extremes import ContactExtremes as ContactExtremes, contact_extremes as contact_extremes
from .feedback import (
    AbstractLaw as AbstractLaw,
    FollowSchedules as FollowSchedules,
    FunctionLaw as FunctionLaw,
    Servo as Servo,
)
from .force import (
    AbstractForce as AbstractForce,
    FunctionForce as FunctionForce,
    HarmonicForce as HarmonicForce,
)
from .frames import (
    AbstractFrame as AbstractFrame,
    MatrixFrame as MatrixFrame,
    SphericalFrame as SphericalFrame,
    VersorFrame as VersorFrame,
)
from .harmonics import HarmonicSeries as HarmonicSeries
from .motion import (
    Driven as Driven,
    Fixed as Fixed,
    Free as Free,
    OnRail as OnRail,
    Oscillating as Oscillating,
)
from .observables import Observables as Observables, observe as observe
from .occurrences import Occurrences as Occurrences
from .rails import (
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
from .results import load_run as load_run, save as save, to_dataset as to_dataset
from .scenario import (
    Scenario as Scenario,
    ScenarioError as ScenarioError,
    load_scenario as load_scenario,
    read_scenario as read_scenario,
    write_scenario as write_scenario,
)
from .schedules import (
    AbstractSchedule as AbstractSchedule,
    ConstantRate as ConstantRate,
    FunctionSchedule as FunctionSchedule,
    PiecewiseAcceleration as PiecewiseAcceleration,
    Pulse as Pulse,
    Sinusoids as Sinusoids,
    Waypoints as Waypoints,
)
from .simulation import PrecisionError as PrecisionError, simulate as simulate
from .state import (
    BallState as BallState,
    DiskState as DiskState,
    ReducedState as ReducedState,
    RotationState as RotationState,
    State as State,
)
from .status import SolveError as SolveError, Status as Status
from .trajectory import Trajectory as Trajectory
from .validity import problems as problems
