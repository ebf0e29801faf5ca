"""Robots in general engines, beside the exact solution: ``python -m benchmarks engines``.

Nothing here imports an engine: its own file, which does, is imported when it takes part.
"""

from typing import Any

from ..contenders import Family
from .contract import CASES as CASES, Case as Case, Engine as Engine, Motion as Motion, Setting as Setting

_ELLIPTIC = {"cone": "elliptic", "impratio": 100.0}
_STIFF = {"solref steps": 2.0, "solimp": (0.99, 0.9999, 0.001, 0.5, 2.0), "tolerance": 1e-12}


def _discrete(approximation: str) -> dict[str, Any]:
    return {"plant": {"discrete_contact_approximation": approximation}}


_CENIC = {"continuous": True, "scheme": "cenic"}
_SLIP = "Modeling, Preventing slip, Slow slippage"

MUJOCO = Engine(
    Family("MuJoCo", "mujoco_", ("mujoco",), "engines"),
    (
        Setting("as it comes", "the defaults: Euler, pyramidal cones, condim 3"),
        # "high impratio values work well only with elliptic cones"; 100 is what MuJoCo's own Menagerie has for feet.
        Setting("impratio 100", f"{_SLIP} (a)", {**_ELLIPTIC, "integrator": "implicitfast"}),
        # "A small number (1, 2 or 3) is usually sufficient."
        Setting("noslip 3", f"{_SLIP} (b)", {**_ELLIPTIC, "integrator": "implicitfast", "noslip_iterations": 3}),
        Setting("RK4", "Computation, Numerical integration", {**_ELLIPTIC, "integrator": "RK4"}),
        # Neither friction against spinning nor against rolling is wanted, but 1e-5 of both is the least.
        Setting("RK4, condim 6", "Computation, Contact", {**_ELLIPTIC, "integrator": "RK4", "condim": 6}),
        # The time constant of a contact "should be at least two times larger than the simulation time step".
        Setting("RK4, stiff", "Modeling, Solver parameters", {**_ELLIPTIC, **_STIFF, "integrator": "RK4"}),
        Setting("implicitfast, stiff", "the same", {**_ELLIPTIC, **_STIFF, "integrator": "implicitfast"}),
    ),
)
DRAKE = Engine(
    Family("Drake", "drake_", ("pydrake",), "engines"),
    (
        Setting("Lagged", "MultibodyPlant, discrete_contact_approximation: the default", _discrete("lagged")),
        Setting("SAP", "the same", _discrete("sap")),
        Setting("TAMSI", "the same", _discrete("tamsi")),
        Setting("continuous", "time_step 0: compliant contact; the step is the accuracy", {"continuous": True}),
        # "Users specify a desired accuracy rather than a fixed time step."
        Setting("CENIC", "CenicIntegrator; the step is the accuracy", _CENIC),
        # So stiff that the ball does not sink measurably: what is left is the error of the steps.
        Setting("CENIC, stiff", "AddContactMaterial, point_stiffness", {**_CENIC, "stiffness": 1e8}),
    ),
)
PYBULLET = Engine(
    Family("PyBullet", "pybullet_", ("pybullet",), "pybullet"),
    (
        Setting("as it comes", "the defaults, without its damping"),
        # "Choose the maximum number of constraint solver iterations": the default is 50.
        Setting("500 iterations", "Quickstart Guide, setPhysicsEngineParameter", {"numSolverIterations": 500}),
    ),
)
ENGINES = {engine.family.name: engine for engine in (MUJOCO, DRAKE, PYBULLET)}
