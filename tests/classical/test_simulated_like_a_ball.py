"""What `simulate` gives for a ball it gives for a classical system: status, dense output, derivatives, errors."""

from typing import NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import jaxtyping
import numpy as np
import pytest

import jaxball
from jaxball import Status
from jaxball.physics import classical
from jaxball.simulation.solvers import RadauIIA
from tests.support.sentences import refuses, said

TIMES = np.linspace(0.0, 2.0, 41)
TOP = {"mass": 0.5, "inertia": (1.3, 1.3, 0.8), "chi": (0.0, 0.0, 0.7), "gravity": 3.0}
SUSLOV = {"inertia": (1.0, 1.6, 2.1), "xi": (0.0, 0.0, 1.0)}
START = classical.RigidBodyState([0.9, 0.3, -0.3, 0.1], [0.4, -0.3, 1.9])


@pytest.fixture(scope="module")
def top():
    return jaxball.simulate(classical.HeavyTop(**TOP), TIMES, START, rtol=1e-12, atol=1e-12, dense=True)


@pytest.mark.thorough
def test_a_top_at_rest_stands_by_default():
    run = jaxball.simulate(classical.HeavyTop(**TOP), TIMES, dense=True)
    assert run.ok
    np.testing.assert_array_equal(run.state.Omega, 0.0)
    np.testing.assert_array_equal(run.state.q[:, 0], 1.0)


def test_dense_output(top):
    """The solver's polynomials, evaluated by another program: some roundings of numbers up to 2."""
    np.testing.assert_allclose(top.at(TIMES).Omega, top.state.Omega, rtol=0, atol=1e-14)
    assert np.all(np.isnan(top.at(3.0).q))


def test_words(top):
    assert str(top).startswith("Trajectory of a heavy top\n  41 times from 0 to 2\n")


@pytest.mark.slow
def test_the_differential_algebraic_form_keeps_the_versor(top):
    """At the ends of steps, to the error that the iteration leaves."""
    run = jaxball.simulate(
        classical.HeavyTop(**TOP), TIMES, START, solver=RadauIIA(stages=3), rtol=1e-8, atol=1e-8, dae=True
    ).raise_if_failed()
    np.testing.assert_allclose(run.laws.versor_squared[-1], 1.0, rtol=0, atol=1e-11)
    np.testing.assert_allclose(run.state.Omega, top.state.Omega, rtol=0, atol=1e-8)


@pytest.mark.long
def test_many_at_once_and_their_derivatives():
    """∂x(2)/∂ẋ(0) of the particle is (x(2) − x(0)) / ẋ(0), for x − x(0) is linear in ẋ(0)."""

    @jax.jit
    @jax.vmap
    def displaced(xdot):
        def x(xdot):
            start = classical.ParticleState(1.0, 1.0, 0.0, xdot, 1.0)
            particle = classical.NonholonomicParticle()
            return jaxball.simulate(particle, TIMES, start, adjoint=diffrax.ForwardMode()).state.x[-1]

        return jax.jvp(x, (xdot,), (jnp.ones_like(xdot),))

    xdot = jnp.array([0.5, 1.0, 2.0])
    x, slope = displaced(xdot)
    np.testing.assert_allclose(slope, (x - 1.0) / xdot, rtol=1e-8)


class Oscillation(classical.AbstractClassicalState):
    u: jaxtyping.Float[jax.Array, ""] = eqx.field(converter=jnp.asarray, default=1.0)
    v: jaxtyping.Float[jax.Array, ""] = eqx.field(converter=jnp.asarray, default=0.0)


class Energy(NamedTuple):
    energy: jax.Array


class Oscillator(classical.AbstractClassicalSystem[Oscillation]):
    """A system of one's own."""

    stiffness: jaxtyping.Float[jax.Array, ""] = eqx.field(converter=jnp.asarray)

    title = "oscillator"
    state_type = Oscillation

    def field(self, t, state):
        return Oscillation(state.v, -self.stiffness * state.u)

    def laws(self, t, state):
        return Energy(0.5 * state.v**2 + 0.5 * self.stiffness * state.u**2)


def test_a_system_of_ones_own():
    run = jaxball.simulate(Oscillator(4.0), TIMES).raise_if_failed()
    np.testing.assert_allclose(run.state.u, np.cos(2 * TIMES), rtol=0, atol=3e-8)
    np.testing.assert_allclose(run.laws.energy, 2.0, rtol=1e-7)
    assert set(run.to_dataset().data_vars) == {"u", "v", "energy"}


@pytest.mark.parametrize(
    ("make", "state", "named"),
    [
        (lambda: classical.HeavyTop(**{**TOP, "mass": -1.0}), None, "mass"),
        (lambda: classical.HeavyTop(**{**TOP, "inertia": (1.0, 1.0, 2.5)}), None, "inertia"),
        (lambda: classical.HeavyTop(**{**TOP, "inertia": (1.0, 1.0, 0.0)}), None, "inertia"),
        (lambda: classical.HeavyTop(**{**TOP, "gravity": np.nan}), None, "gravity"),
        (lambda: classical.HeavyTop(**{**TOP, "chi": (0.0, 0.0, 1.4)}), None, "chi"),
        (lambda: classical.HeavyTop(**TOP), classical.RigidBodyState([1.0, 1.0, 0.0, 0.0]), "state.q"),
        (lambda: classical.HeavyTop(**TOP), classical.RigidBodyState(Omega=[np.nan, 0, 0]), "state.Omega"),
        (lambda: classical.SuslovProblem(**SUSLOV), classical.RigidBodyState(Omega=[1.0, 0.0, 0.1]), "state.Omega"),
        (lambda: classical.SuslovProblem(**{**SUSLOV, "xi": (0.0, 0.0, 0.0)}), None, "xi"),
        (lambda: classical.NonholonomicParticle(mass=0.0), None, "mass"),
    ],
)
def test_what_cannot_be_does_not_start(make, state, named):
    system = make()
    state = system.state_type() if state is None else state
    said("\n".join(jaxball.problems(system, state)), named)


def test_the_status_of_what_cannot_be():
    run = jaxball.simulate(classical.HeavyTop(**{**TOP, "chi": (0.0, 0.0, 1.4)}), TIMES, dense=True)
    assert run.status == Status.IMPOSSIBLE
    assert np.all(np.isnan(run.state.q))


def test_possible_bodies_have_no_problems(top):
    assert jaxball.problems(top.system, START) == []
    # A thin rod pinned at its end: d3 → 0 and χ at half its length, a third of m l² about the end.
    rod = classical.HeavyTop(mass=1.0, inertia=(1 / 3, 1 / 3, 1e-9), chi=(0.0, 0.0, 0.5))
    assert jaxball.problems(rod) == []
    # All mass in one point at χ: the nearest that a body can come to a pendulum.
    point = classical.HeavyTop(mass=1.0, inertia=(1.0, 1.0, 1e-9), chi=(0.0, 0.0, 1.0))
    assert jaxball.problems(point) == []


def test_xi_is_looked_at_where_the_run_starts():
    """ξ turns with time, and Ω must be orthogonal to it at the start of the run, not at 0."""
    axis = classical.HarmonicAxis([0.0, 0.0, 0.0], [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], [1.0, 1.0], [np.pi / 2, 0.0])
    problem = classical.SuslovProblem(inertia=SUSLOV["inertia"], xi=axis)
    start = classical.RigidBodyState(Omega=[1.0, 0.0, 0.0])
    assert jaxball.problems(problem, start, np.pi / 2) == []
    assert jaxball.problems(problem, start)


@pytest.mark.usefixtures("no_type_checks")
@pytest.mark.parametrize(
    ("make", "error", "named"),
    [
        (lambda: classical.FreeRigidBody(inertia=1.0), ValueError, "inertia"),
        (lambda: classical.HeavyTop(**{**TOP, "chi": 1.0}), ValueError, "chi"),
        (lambda: classical.HarmonicAxis([1.0, 0.0]), ValueError, "constant"),
        (lambda: jaxball.simulate(classical.HeavyTop(**TOP), TIMES, jaxball.BallState()), TypeError, "state"),
        (lambda: jaxball.simulate(jaxball.Ball(mass=1.0, inertia=(1.0, 1.0, 1.0)), TIMES, START), TypeError, "state"),
        (
            lambda: jaxball.simulate(classical.NonholonomicParticle(), TIMES, solver=RadauIIA(stages=3), dae=True),
            TypeError,
            "state",
        ),
    ],
)
def test_sentences(make, error, named):
    with refuses(error, named):
        make()


def test_laws_and_observables_are_of_different_systems(top):
    ball = jaxball.Ball(mass=1.0, inertia=(1.0, 1.0, 1.0))
    rolling = eqx.tree_at(lambda run: (run.system, run.state), top, (ball, jaxball.BallState()))
    with refuses(ValueError, "laws"):
        _ = top.observables
    with refuses(ValueError, "laws"):
        _ = rolling.laws
