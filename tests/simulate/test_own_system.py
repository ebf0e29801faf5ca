"""Systems that are not jaxball's get what its own get, by the contract alone: compared with their closed forms."""

from typing import ClassVar, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float

import jaxball
from jaxball import Status
from jaxball.analysis.chaos import lyapunov_spectrum
from jaxball.physics.conditions import Condition, positive
from jaxball.simulation.ensemble import simulate_ensemble
from jaxball.simulation.solvers import RadauIIA
from tests.support.sentences import refuses, said

TIMES = np.linspace(0.0, 3.0, 31)


def number(default):
    return eqx.field(converter=jnp.asarray, default=default)


class Turning(jaxball.physics.AbstractState):
    theta: Float[Array, "*batch"] = number(0.0)
    thetadot: Float[Array, "*batch"] = number(1.0)


class AngularMomentum(NamedTuple):
    L: Float[Array, "*batch"]


class Reeled(jaxball.AbstractSystem[Turning]):
    """A mass on a horizontal line that is let out, of length √(1 + ct): θ̇ (1 + ct) is constant. It packs that for θ̇."""

    c: Float[Array, "*batch"] = number(1.0)

    title: ClassVar[str] = "reeled mass"
    state_type: ClassVar[type[Turning]] = Turning

    def field(self, t, state):
        return Turning(state.thetadot, -self.c * state.thetadot / (1 + self.c * t))

    def to_packed(self, t, state):
        return Turning(state.theta, state.thetadot * (1 + self.c * t))

    def from_packed(self, t, packed):
        return Turning(packed.theta, packed.thetadot / (1 + self.c * t))

    def field_of_packed(self, t, packed):
        return Turning(self.from_packed(t, packed).thetadot, jnp.zeros_like(packed.thetadot))

    def laws(self, t, state):
        return AngularMomentum(state.thetadot * (1 + self.c * t))

    def conditions(self):
        yield Condition(positive(self.c), "c", self.c, "a positive number")


def angle(t, c=1.0):
    return np.log(1 + c * t) / c


@pytest.mark.thorough
def test_what_is_packed_is_advanced_and_unpacked():
    """The packed momentum has the rate 0, and so no rounding but that of packing."""
    passed = jaxball.Event(lambda system, t, state: state.theta - 0.5)
    run = jaxball.simulate(Reeled(), TIMES, dense=True, events={"passed": passed}, throw=True)
    np.testing.assert_allclose(run.state.theta, angle(TIMES), rtol=0, atol=1e-9)
    np.testing.assert_allclose(run.laws.L, 1.0, rtol=0, atol=1e-15)
    np.testing.assert_allclose(run.at(1.23).thetadot, 1 / 2.23, rtol=1e-15)
    np.testing.assert_allclose(run.events["passed"].times[0], np.exp(0.5) - 1, rtol=1e-9)
    np.testing.assert_allclose(run.events["passed"].state.thetadot[0], np.exp(-0.5), rtol=1e-9)


@pytest.mark.thorough
@pytest.mark.parametrize(("differentiate", "adjoint"), [(jax.jacfwd, diffrax.ForwardMode()), (jax.grad, None)])
def test_derivatives(differentiate, adjoint):
    """d/dc log(1 + ct)/c at c = 1."""

    def last(c):
        return jaxball.simulate(Reeled(c), TIMES, adjoint=adjoint).state.theta[-1]

    np.testing.assert_allclose(jax.jit(differentiate(last))(jnp.array(1.0)), 3 / 4 - np.log(4), rtol=1e-8)


@pytest.mark.thorough
def test_many_at_once():
    c = np.array([0.5, 1.0, 2.0])
    many = simulate_ensemble(Reeled(c), TIMES, Turning(jnp.zeros(3), jnp.ones(3))).trajectory
    np.testing.assert_allclose(many.state.theta, angle(TIMES, c[:, None]), rtol=0, atol=1e-8)
    np.testing.assert_allclose(many.state.thetadot, 1 / (1 + c[:, None] * TIMES), rtol=1e-12)


def test_what_cannot_be():
    (problem,) = jaxball.problems(Reeled(-1.0))
    said(problem, "c")
    assert jaxball.simulate(Reeled(-1.0), TIMES).status == Status.IMPOSSIBLE


class Pointing(jaxball.physics.AbstractState):
    n: Float[Array, "3"] = eqx.field(converter=jnp.asarray, default=(1.0, 0.0, 0.0))

    unit_vector = "n"


class Attracted(jaxball.AbstractSystem[Pointing]):
    """A direction that is drawn to e3: n₃ = tanh(t) from the horizon, the rates across it die as e⁻ᵗ."""

    state_type: ClassVar[type[Pointing]] = Pointing

    def field(self, t, state):
        up = jnp.array([0.0, 0.0, 1.0])
        return Pointing(up - state.n[2] * state.n)


@pytest.mark.thorough
@pytest.mark.parametrize(
    "settings", [{"project": True}, {"dae": True, "solver": RadauIIA(stages=5)}], ids=["project", "dae"]
)
def test_a_unit_vector_is_kept(settings):
    run = jaxball.simulate(Attracted(), [0.0, 1.0, 2.0], rtol=1e-9, atol=1e-9, step_to_times=True, **settings)
    np.testing.assert_allclose(run.state.n[:, 2], np.tanh([0.0, 1.0, 2.0]), rtol=0, atol=1e-8)
    # The iteration of an implicit method leaves a part of the tolerance.
    np.testing.assert_allclose(jnp.sum(run.state.n**2, axis=1), 1.0, rtol=0, atol=1e-10 if "dae" in settings else 1e-15)
    assert run.laws == ()


def test_a_unit_vector_counts_one_dimension_less():
    """At the pole, deviations within the sphere have the rate −1, and that along n is none of them."""
    spectrum = lyapunov_spectrum(Attracted(), (0.0, 10.0), Pointing([0.0, 0.0, 1.0]))
    np.testing.assert_allclose(spectrum.exponents, [-1.0, -1.0], rtol=0, atol=1e-7)
    (problem,) = jaxball.problems(Attracted(), Pointing([1.0, 1.0, 0.0]))
    said(problem, "state.n")


class Nameless(jaxball.AbstractSystem):
    def field(self, t, state):
        return state


class Bare(jaxball.AbstractSystem[Turning]):
    state_type: ClassVar[type[Turning]] = Turning

    def field(self, t, state):
        return jnp.stack([state.thetadot, state.theta])


@pytest.mark.parametrize(
    ("system", "named"),
    [
        (Nameless(), "state_type = MyState"),
        (Bare(), "field"),
    ],
    ids=["state_type", "field"],
)
def test_a_contract_that_is_not_fulfilled_is_told(system, named):
    with refuses(TypeError, named):
        jaxball.simulate(system, TIMES)


class Counted(Turning):
    """The same state, where it is annotated without a kind of numbers."""

    turns: jax.Array = number(0)


@pytest.mark.parametrize(
    ("state", "field"),
    [
        (Turning(1, 0.5), "theta"),
        (Turning(0.5, np.array(2)), "thetadot"),
        (Turning(0.5, True), "thetadot"),
        (Counted(), "turns"),
    ],
)
def test_whole_numbers_in_a_state_are_no_mode(state, field):
    """They were rounded at every step, without a word: only what is annotated as an integer is a mode."""
    with refuses(TypeError, f"state.{field}"):
        jaxball.simulate(Reeled(), TIMES, state)


def test_a_whole_number_put_into_a_state_is_refused():
    ball = jaxball.Ball(mass=1.0, inertia=(1.0, 1.0, 1.0))
    state = eqx.tree_at(lambda state: state.z, jaxball.BallState(), jnp.array([0, 0]))
    with refuses(TypeError, "state.z"):
        jaxball.simulate(ball, TIMES, state)
