"""A body with a law of contact on a table that ends: it leaves where it touches, and flies on where it does not."""

import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float

from jaxball import Ball, BallState, Contact, Disk, DiskState, Resistance, Status, simulate
from jaxball.physics import AbstractSurface, Mode, MovingFrame, ReleasedState

G, EDGE = 9.81, 2.0
SHELL = {"mass": 1.0, "radius": 0.1, "gravity": G}
LAW = Contact(0.3, restitution=0.5, slowest=0.1)


class Table(AbstractSurface):
    edge: Float[Array, ""]
    motion: MovingFrame | None = None

    def point(self, t, u1, u2):
        return jnp.stack([u1, u2, 0.0 * u1])

    def reach(self, t, u1, u2):
        return 1 - u1 / self.edge


def ball(**others):
    return Ball(**SHELL, inertia=(0.004,) * 3, ground=Table(jnp.array(EDGE)), **others)


def disk():
    return Disk(**SHELL, inertia=0.005, ground=Table(jnp.array(EDGE)))


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("body", "start", "law"),
    [
        (ball(), BallState(Omega=(0.0, 5.0, 0.0)), LAW),
        (ball(), ReleasedState(BallState(), V=(0.5, 0.2, 0.0)), Contact(0.0)),
        (disk(), DiskState(phidot=-5.0), LAW),
        (ball(resistance=Resistance(dry=1e-9, exact=True)), BallState(Omega=(0.0, 5.0, 0.0)), LAW),
    ],
    ids=["rolls", "slides", "disk", "exact resistance"],
)
def test_what_touches_the_table_leaves_at_its_edge(body, start, law):
    """At 0.5 to the edge at 2."""
    run = simulate(body, [0.0, 1.0, 6.0, 7.0, 8.0, 9.0], start, contact=law)  # as many times as below
    assert run.status == Status.LEFT_SURFACE
    np.testing.assert_allclose(run.reached, EDGE / 0.5, rtol=1e-5)
    assert np.isfinite(run.state.z[1]).all()


@pytest.mark.thorough
@pytest.mark.parametrize("kind", ["ball", "disk"])
@pytest.mark.parametrize("speed", [1.9, 2.4])
def test_in_flight_a_body_lands_before_the_edge_and_flies_on_beyond_it(kind, speed):
    """From the height h it is at the level of the table after √(2h/g), at 2 at the speed 2√(g/2h)."""
    h = 4.905  # so that it falls for 1
    body, state = (ball(), BallState()) if kind == "ball" else (disk(), DiskState())
    times = np.array([0.0, 0.5, 0.99, 1.01, 1.5, 3.0])
    run = simulate(body, times, ReleasedState(state, V=(speed, 0.0, 0.0), height=h), contact=LAW)
    falls = np.stack([speed * times, 0 * times, 0.1 + h - 0.5 * G * times**2], axis=1)
    if speed < EDGE:
        np.testing.assert_allclose(run.contact.switches.times[0], 1.0, rtol=1e-7)
        return
    assert run.ok
    assert int(run.contact.switches.count) == 0
    assert np.all(np.asarray(run.contact.mode) == Mode.FLIGHT)
    np.testing.assert_allclose(run.observables.geometric_centre, falls, atol=1e-7)
    np.testing.assert_allclose(run.observables.energy, run.observables.energy[0], rtol=1e-9)


@pytest.mark.thorough
def test_a_body_that_bounces_over_the_edge_falls():
    """It lands at 1.9 after 1, rises with half the speed, and is beyond the edge when it is down again."""
    times = np.array([0.0, 0.5, 1.0, 1.5, 2.0, 2.5])
    run = simulate(ball(), times, ReleasedState(BallState(), V=(1.9, 0.0, 0.0), height=4.905), contact=LAW)
    assert run.ok
    assert int(run.contact.switches.count) == 1
    t = 1.5
    V = np.asarray(run.contact.switches.after.V[0])
    np.testing.assert_allclose(V[2], 0.5 * G, rtol=1e-7)
    np.testing.assert_allclose(run.observables.geometric_centre[-1, 2], 0.1 + V[2] * t - 0.5 * G * t**2, atol=1e-6)
