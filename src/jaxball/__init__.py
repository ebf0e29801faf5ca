"""A differentiable simulator of a ball, or a disk, that rolls without slipping and is driven by point
masses moving inside it, after Putkaradze & Rogers (2018).
"""

import importlib

TYPE_CHECKING = False  # as of the module `typing`, which takes a while to import

if TYPE_CHECKING:
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
    from .results import save as save, to_dataset as to_dataset
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

# Where each name is, for those who run the code; the imports above say the same to those who check its types.
_HOMES = {
    "body": "Ball Disk PointMass System with_integrated_angles with_masses",
    "dynamics": "vector_field",
    "equilibrium": "Balance balance with_angles",
    "events": "AbstractEvent Detachment Event Slip",
    "extremes": "ContactExtremes contact_extremes",
    "feedback": "AbstractLaw FollowSchedules FunctionLaw Servo",
    "force": "AbstractForce FunctionForce HarmonicForce",
    "frames": "AbstractFrame MatrixFrame SphericalFrame VersorFrame",
    "harmonics": "HarmonicSeries",
    "motion": "Driven Fixed Free OnRail Oscillating",
    "observables": "Observables observe",
    "occurrences": "Occurrences",
    "rails": "AbstractRail BernoulliEight Circle Ellipse FourierRail FunctionRail GeronoEight SplineRail Tube",
    "results": "save to_dataset",
    "scenario": "Scenario ScenarioError load_scenario read_scenario write_scenario",
    "schedules": "AbstractSchedule ConstantRate FunctionSchedule PiecewiseAcceleration Pulse Sinusoids Waypoints",
    "simulation": "PrecisionError simulate",
    "state": "BallState DiskState ReducedState RotationState State",
    "status": "SolveError Status",
    "trajectory": "Trajectory",
    "validity": "problems",
}
_HOME_OF = {name: module for module, names in _HOMES.items() for name in names.split()}
_PACKAGES = (
    "bench",
    "chaos",
    "classical",
    "cpu",
    "design",
    "ensemble",
    "paper",
    "plot",
    "rails",
    "reproduce",
    "results",
    "scenario",
    "schedules",
    "solvers",
    "stability",
    "sweep",
    "verify",
)

__all__ = [*_HOME_OF]  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str):
    """A public name, imported when it is first asked for, so that the command line starts before JAX does."""
    if name in _HOME_OF:
        value = getattr(importlib.import_module(f".{_HOME_OF[name]}", __name__), name)
        globals()[name] = value
        return value
    if name in _PACKAGES:
        return importlib.import_module(f".{name}", __name__)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*_HOME_OF, *_PACKAGES])
