"""A user's own system that a plane holds: what it says of the plane is what its runs report."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float

import jaxball
from jaxball import Detachment, Status, contact_extremes
from jaxball.analysis.verify import check_laws
from jaxball.physics import AbstractRollingSystem, Reaction
from tests.support.sentences import refuses

MASS, GRAVITY, AMPLITUDE, FREQUENCY = 2.0, 9.8, 0.3, 5.0


class Carried(jaxball.physics.AbstractState):
    """How far a roller has come."""

    x: Float[Array, ""] = eqx.field(converter=jnp.asarray, default=0.0)


class ShakenRoller(AbstractRollingSystem[Carried]):
    """A roller at a steady speed on a table that goes up and down as A cos ωt: N = m (g − A ω² cos ωt), f = 0."""

    amplitude: Float[Array, ""] = eqx.field(converter=jnp.asarray)

    title: ClassVar[str] = "shaken roller"
    state_type: ClassVar[type[Carried]] = Carried

    def field(self, t, state):
        return Carried(jnp.ones_like(state.x))

    def plane_reaction(self, t, state):
        return Reaction(MASS * (GRAVITY - self.amplitude * FREQUENCY**2 * jnp.cos(FREQUENCY * t)), 0.0 * state.x)

    @property
    def weight(self):
        return jnp.asarray(MASS * GRAVITY)


@pytest.mark.thorough
@pytest.mark.parametrize("amplitude", [AMPLITUDE, 0.5])
def test_its_extremes_are_those_of_the_table(amplitude):
    """At t = 2π/ω, within the run; the shaking lifts it where A ω² > g."""
    start = np.pi / FREQUENCY  # the table is at its lowest
    run = jaxball.simulate(ShakenRoller(amplitude), [start, start + 1.0], dense=True)
    extremes = contact_extremes(run)
    np.testing.assert_allclose(extremes.margin, 1 - amplitude * FREQUENCY**2 / GRAVITY, rtol=1e-9)
    np.testing.assert_allclose(extremes.least_normal_force_time, 2 * np.pi / FREQUENCY, rtol=1e-6)
    assert bool(extremes.holds) is (amplitude == AMPLITUDE)
    ended = jaxball.simulate(ShakenRoller(amplitude), [start, start + 1.0], events={"lift": Detachment()})
    assert ended.ok is (amplitude == AMPLITUDE)
    if not ended.ok:
        assert ended.status == Status.DETACHED
        lifted = (2 * np.pi - np.arccos(GRAVITY / (amplitude * FREQUENCY**2))) / FREQUENCY
        np.testing.assert_allclose(ended.reached, lifted, rtol=1e-8)


@pytest.mark.thorough
def test_verify_says_whether_the_table_holds_it():
    rows = [check_laws(ShakenRoller(a), [0.6, 1.6], laws=["contact"])["contact"] for a in (AMPLITUDE, 0.5)]
    assert [row.ok for row in rows] == [True, False]


def test_a_class_without_a_reaction_is_none():
    class Without(AbstractRollingSystem[Carried]):
        state_type: ClassVar[type[Carried]] = Carried

        def field(self, t, state):
            return state

    with refuses(TypeError, "plane_reaction"):
        Without()
