"""What `simulate` gives for a ball it gives for a classical system: status, dense output, derivatives, errors."""

import re
from typing import NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import jaxtyping
import numpy as np
import pytest

import jaxball
from jaxball import Status, classical
from jaxball.solvers import RadauIIA

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
    assert set(jaxball.to_dataset(run).data_vars) == {"u", "v", "energy"}


@pytest.mark.parametrize(
    ("make", "state", "sentence"),
    [
        (lambda: classical.HeavyTop(**{**TOP, "mass": -1.0}), None, "`mass` must be a positive number"),
        (lambda: classical.HeavyTop(**{**TOP, "inertia": (1.0, 1.0, 2.5)}), None, "none exceeds the sum"),
        (
            lambda: classical.HeavyTop(**{**TOP, "inertia": (1.0, 1.0, 0.0)}),
            None,
            "`inertia` must be a list of 3 positive",
        ),
        (lambda: classical.HeavyTop(**{**TOP, "gravity": np.nan}), None, "`gravity` must be a finite number"),
        (lambda: classical.HeavyTop(**{**TOP, "chi": (0.0, 0.0, 1.4)}), None, "`chi` must be a position.*smaller mass"),
        (
            lambda: classical.HeavyTop(**TOP),
            classical.RigidBodyState([1.0, 1.0, 0.0, 0.0]),
            "`state.q` must be a versor",
        ),
        (lambda: classical.HeavyTop(**TOP), classical.RigidBodyState(Omega=[np.nan, 0, 0]), "`state.Omega` .* finite"),
        (
            lambda: classical.SuslovProblem(**SUSLOV),
            classical.RigidBodyState(Omega=[1.0, 0.0, 0.1]),
            "`state.Omega` must be orthogonal to xi",
        ),
        (lambda: classical.SuslovProblem(**{**SUSLOV, "xi": (0.0, 0.0, 0.0)}), None, "`xi` must be .* not all zero"),
        (lambda: classical.NonholonomicParticle(mass=0.0), None, "`mass` must be a positive number"),
    ],
)
def test_what_cannot_be_does_not_start(make, state, sentence):
    system = make()
    state = system.state_type() if state is None else state
    found = jaxball.problems(system, state)
    assert len(found) >= 1
    assert any(re.search(sentence, line) for line in found), found


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
    ("make", "error", "sentence"),
    [
        (
            lambda: classical.FreeRigidBody(inertia=1.0),
            ValueError,
            r"`inertia` must be 3 numbers, but its shape is \(\)",
        ),
        (lambda: classical.HeavyTop(**{**TOP, "chi": 1.0}), ValueError, "`chi` must be 3 numbers"),
        (lambda: classical.HarmonicAxis([1.0, 0.0]), ValueError, "`constant` must be 3 numbers"),
        (
            lambda: jaxball.simulate(classical.HeavyTop(**TOP), TIMES, jaxball.BallState()),
            TypeError,
            "`state` must be a RigidBodyState for a HeavyTop, but it is a BallState",
        ),
        (
            lambda: jaxball.simulate(jaxball.Ball(mass=1.0, inertia=(1.0, 1.0, 1.0)), TIMES, START),
            TypeError,
            "`state` must be a BallState, RotationState or ReducedState for a Ball, but it is a RigidBodyState",
        ),
        (
            lambda: jaxball.simulate(classical.NonholonomicParticle(), TIMES, solver=RadauIIA(stages=3), dae=True),
            TypeError,
            "`state` must be a state with a unit vector.*RigidBodyState where `dae` is True",
        ),
    ],
)
def test_sentences(make, error, sentence):
    with pytest.raises(error, match=sentence):
        make()


def test_laws_and_observables_are_of_different_systems(top):
    ball = jaxball.Ball(mass=1.0, inertia=(1.0, 1.0, 1.0))
    rolling = eqx.tree_at(lambda run: (run.system, run.state), top, (ball, jaxball.BallState()))
    with pytest.raises(ValueError, match="this trajectory is of a HeavyTop; its `laws`"):
        _ = top.observables
    with pytest.raises(ValueError, match="this trajectory is of a Ball"):
        _ = rolling.laws
