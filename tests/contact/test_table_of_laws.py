"""Every cell of the table of laws and questions in the documentation: asked of a small run, or refused."""

import functools
import re
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import (
    Ball,
    BallState,
    Contact,
    ConvexBody,
    Disk,
    DiskState,
    Event,
    HardStops,
    JointFriction,
    Motor,
    Resistance,
    planar_pendulum,
    simulate,
)
from jaxball.analysis.chaos import lyapunov_spectrum, poincare_map
from jaxball.analysis.stability import periodic_motion
from jaxball.analysis.verify import check_laws
from jaxball.control import tvlqr
from jaxball.control.environments import Environment, ReachPoint
from jaxball.control.estimation import ErrorStateFilter
from jaxball.physics import Ellipsoid, JointForces, LimitSurface
from jaxball.physics.classical import DryFriction, LagrangianState, LagrangianSystem, UnilateralContact
from jaxball.physics.sensors import Gyroscope, SensorErrors
from jaxball.simulation.ensemble import simulate_ensemble

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "laws.md"
TIMES = np.linspace(0.0, 0.4, 3)


def disk(*forces: Any, **others: Any) -> tuple[Any, Any]:
    """A disk with a pendulum that has these forces, beside a motor, and its state."""
    pendulum = planar_pendulum(0.4, 0.5, drive=JointForces((Motor(0.05, limit=1.0), *forces)))
    start = DiskState(phidot=0.4, theta=(0.1,), thetadot=(0.3,))
    return Disk(mass=1.0, inertia=0.5, mechanisms=[pendulum], **others), start


def ball(kind: Any = Ball, **others: Any) -> tuple[Any, Any]:
    numbers = {"mass": 1.0, "inertia": (0.4, 0.4, 0.5), "offset": (0.0, 0.0, -0.1)}
    joints = {"theta": (0.1,), "thetadot": (0.3,)} if "mechanisms" in others else {}
    return kind(**numbers | others), BallState(Omega=(0.2, 0.4, 0.3), **joints)


def lagrangian(**rows: Any) -> tuple[Any, Any]:
    def L(t, q, qdot):
        return 0.5 * jnp.sum(qdot**2) - 0.5 * jnp.sum(q**2)

    return LagrangianSystem(L, ("x",), **rows), LagrangianState((0.5,), (0.4,))


DRY, LAW = Resistance(dry=0.02, exact=True), Contact(0.3, restitution=0.4)
# The body with its state, and the law of contact, by the names of the columns.
COLUMNS = {
    "rolls": lambda: (*disk(), None),
    "`Contact`": lambda: (*disk(), LAW),
    "dry, `exact`": lambda: (*disk(resistance=DRY), None),
    "`JointFriction`": lambda: (*disk(JointFriction(0.02)), None),
    "`HardStops`": lambda: (*disk(HardStops(-0.2, 0.2, 0.5)), None),
    "all of these": lambda: (*disk(JointFriction(0.02), HardStops(-0.2, 0.2, 0.5), resistance=DRY), LAW),
    "`LimitSurface`": lambda: (
        *ball(mechanisms=[planar_pendulum(0.1, 0.3, drive=Motor(0.05, limit=1.0))]),
        Contact(LimitSurface(0.3, 0.1)),
    ),
    "`ConvexBody`, `Contact`": lambda: (*ball(ConvexBody, shape=Ellipsoid((1.0, 1.1, 0.9))), LAW),
    "own, rows": lambda: (
        *lagrangian(
            unilateral=[UnilateralContact(lambda t, q: q[0] + 0.6, restitution=0.5)],
            dry=[DryFriction(lambda t, q, qdot: qdot[0], 0.1)],
        ),
        None,
    ),
}


class Asked:
    """What is asked of a column, with the run that most questions start from."""

    def __init__(self, column: str):
        self.system, self.state, self.contact = COLUMNS[column]()

    @functools.cached_property
    def run(self) -> Any:
        return self.simulate(self.state, dense=True)

    def simulate(self, state: Any, **others: Any) -> Any:
        return simulate(self.system, TIMES, state, **self.law, **others)

    @property
    def law(self) -> dict[str, Any]:
        return {} if self.contact is None else {"contact": self.contact}

    @property
    def estimate(self) -> Any:
        """What a filter finds by a gyroscope."""
        sensors, sample = {"gyro": Gyroscope(errors=SensorErrors(noise=0.1))}, float(TIMES[1])
        known = ErrorStateFilter.of(self.system, sensors, sample, **self.law)
        return known(self.run.measured(sensors), self.state, {self.state.rotation_rate: 0.1})

    def end(self, scale: Any) -> Any:
        """A number at the end of a run whose start is scaled."""
        moved = jax.tree.map(lambda x: x * scale if jnp.ndim(x) else x, self.state)
        return sum(jnp.sum(leaf) for leaf in jax.tree.leaves(self.simulate(moved).state))


def place(system: Any, t: Any, state: Any) -> Any:
    return (state.q if isinstance(system, LagrangianSystem) else state.z).ravel()[0] - 0.01


ROWS = {
    "states, and the history of modes": lambda x, path: x.run.state,
    "`jax.jacfwd`, and `jax.grad`": lambda x, path: (jax.jacfwd(x.end)(1.0), jax.grad(x.end)(1.0)),
    "an `Event`": lambda x, path: x.simulate(x.state, events={"there": Event(place)}).state,
    "`simulate_ensemble`": lambda x, path: (
        simulate_ensemble(
            x.system, TIMES, jax.tree.map(lambda leaf: jnp.stack([leaf, leaf]), x.state), in_axes=(None, 0), **x.law
        ).trajectory.state
    ),
    "`contact_extremes`": lambda x, path: jaxball.contact_extremes(x.run).least_normal_force,
    "`energy_losses`": lambda x, path: x.run.energy_losses(),
    "`verify`": lambda x, path: check_laws(x.system, TIMES, x.state, quick=True, **x.law)["energy"].residual,
    "`save`, `load_run`": lambda x, path: (
        jaxball.save(x.run, path / "run.npz"),
        jaxball.load_run(path / "run.npz", x.system).state,
    ),
    "`save_figures`": lambda x, path: x.run.save_figures(path, "run"),
    "`plot.write_view`": lambda x, path: jaxball.plot.write_view(x.run, path / "run.html"),
    "`poincare_map`": lambda x, path: poincare_map(x.system, section_of(x), (0.0, 0.4), x.state, **x.law).count,
    "`periodic_motion`": lambda x, path: periodic_motion(x.system, x.state, 0.4, iterations=1, **x.law).period,
    "`lyapunov_spectrum`": lambda x, path: (
        lyapunov_spectrum(x.system, (0.0, 0.4), x.state, interval=0.2, exponents=1, **x.law).times
    ),
    "`closed_loop`": lambda x, path: (
        tvlqr(simulate(x.system, TIMES, x.state), 1.0, 1.0, sample=0.1).closed_loop(samples=2, **x.law).states
    ),
    "an `ErrorStateFilter`": lambda x, path: x.estimate.covariance,
    "an `Environment`": lambda x, path: (
        Environment(x.system, ReachPoint(), sample=0.1, **x.law)
        .rollout(jax.random.key(0), lambda seen: jnp.zeros(1), 2)
        .reward
    ),
}


def section_of(asked: Asked) -> Any:
    return "q[0]" if isinstance(asked.system, LagrangianSystem) else "z" if asked.system.planar else "z[0]"


def cells() -> dict[tuple[str, str], bool]:
    """What the page says of each question and column."""
    lines = [line for line in PAGE.read_text().splitlines() if line.startswith("|")]
    table = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    head, rows = table[0][1:], table[2:]
    return {(row[0], name): cell.startswith("yes") for row in rows for name, cell in zip(head, row[1:], strict=True)}


def test_the_table_has_every_question_and_column():
    assert set(cells()) == {(row, column) for row in ROWS for column in COLUMNS}


SLOW = "all of these", "`LimitSurface`", "`ConvexBody`, `Contact`"


@pytest.mark.long
@pytest.mark.parametrize(
    "column", [pytest.param(name, marks=pytest.mark.slow) if name in SLOW else name for name in COLUMNS]
)
def test_each_cell(column, tmp_path, no_type_checks):
    asked, wrong = Asked(column), {}
    for row, ask in ROWS.items():
        try:
            values = jax.tree.leaves(ask(asked, tmp_path))
            arrays = [np.asarray(value) for value in values if isinstance(value, float | np.ndarray | jax.Array)]
            answer = "yes" if all(np.all(np.isfinite(array) | np.isinf(array)) for array in arrays) else "NaN"
        except (TypeError, ValueError) as error:
            answer = str(error)
            assert re.search(r"`\w+", answer), answer  # a sentence that names what it is about
        if (answer == "yes") != cells().get((row, column)):
            wrong[row] = answer
    assert not wrong
