"""The energy that each law takes from a body, against closed forms.

Where a bound has no reason of its own, 1e-9 is ten times the tolerance, as errors of a few steps add up.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import Ball, BallState, Contact, Damper, Disk, DiskState, JointFriction, Resistance, Spring, simulate
from jaxball.physics import ReleasedState, classical

G, M, R = 9.81, 2.0, 0.5
SOLID = 0.4 * M * R**2
TIGHT: dict[str, Any] = {"rtol": 1e-10, "atol": 1e-10, "dense": True}


def ball(**others):
    return Ball(mass=M, inertia=(SOLID,) * 3, radius=R, gravity=G, **others)


@pytest.mark.long
def test_a_ball_that_dry_resistance_stops_loses_all_that_it_had():
    """c m g s over the way s, which ends at 7/10 m v²; its derivative is 7/5 m v, though the ball stops earlier."""
    c, speed = 0.06, 1.2
    brake = 5 / 7 * c * G
    times = jnp.array([0.0, 0.7, 1.9, 2 * speed / brake])

    def lost(v):
        start = BallState(Omega=jnp.stack([0.0, v / R, 0.0]))
        return simulate(ball(resistance=Resistance(dry=c, exact=True)), times, start, **TIGHT).energy_losses()

    found, slope = jax.jvp(lost, (speed,), (1.0,))
    braked = np.minimum(np.asarray(times), speed / brake)
    np.testing.assert_allclose(found.dry, c * M * G * (speed * braked - brake * braked**2 / 2), rtol=1e-8, atol=1e-12)
    np.testing.assert_allclose(found.dry[-1], 0.7 * M * speed**2, rtol=1e-9)
    np.testing.assert_allclose(slope.dry[-1], 1.4 * M * speed, rtol=1e-7)
    for others in (found.slip, found.impacts, found.viscous):
        np.testing.assert_allclose(others, 0, rtol=0, atol=1e-12)
    assert found.joints.shape == (4, 0)


@pytest.mark.long
def test_a_ball_that_drops_slides_and_rolls_to_rest():
    """It loses m g h in the impact, and 1/7 m v² by the slip, but for what dry resistance takes meanwhile."""
    height, speed, mu, c = 0.2, 1.5, 0.3, 0.05
    start = ReleasedState(BallState(), V=(speed, 0.0, 0.0), height=height)
    resisted = ball(resistance=Resistance(dry=c, exact=True))
    run = simulate(resisted, [0.0, 0.3, 8.0], start, contact=Contact(mu), **TIGHT)
    found = run.energy_losses()
    energy = np.asarray(run.observables.energy)
    np.testing.assert_allclose(found.total, energy[0] - energy, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.total[-1], M * (G * height + speed**2 / 2), rtol=1e-9)
    np.testing.assert_array_equal(found.slip, run.history.over_time["friction_loss"])
    assert found.dry[-1] > 0.1


@pytest.mark.long
@pytest.mark.parametrize("mode", [jax.jacfwd, pytest.param(jax.jacrev, marks=pytest.mark.slow)])
def test_dry_friction_of_a_joint_takes_its_level_times_the_way(mode):
    """A block on a spring comes closer to the middle by 2F/k in each half swing, and sticks within F/k."""
    mass, stiffness, dry, first = 0.5, 8.0, 0.3, 0.62
    period = np.pi * np.sqrt(mass / stiffness)

    def lost(dry):
        drive = Spring(stiffness) + JointFriction(dry, 1.5 * dry)
        tube = jaxball.physics.mass_in_tube(mass, (0.0, 0.0, 1.0), drive=drive)
        disk = Disk(mass=1.0, inertia=0.5, gravity=0.0, mechanisms=[tube])
        run = simulate(disk, [0.0, 3 * period, 9 * period], DiskState(theta=[first], thetadot=[0.0]), **TIGHT)
        return run.energy_losses().joints[:, 0]

    half = np.arange(1, 4)
    way = np.sum(2 * (first - (2 * half - 1) * dry / stiffness))
    # It sticks where it turns back within the static level.
    ends = first - 2 * np.arange(20) * dry / stiffness
    last = ends[np.argmax(np.abs(ends) * stiffness <= 1.5 * dry)]
    assert last > 0
    expected = np.array([0.0, dry * way, stiffness * (first**2 - last**2) / 2])
    rate, value = jaxball.jit(mode(lambda dry: (lost(dry),) * 2, has_aux=True))(dry)
    np.testing.assert_allclose(value, expected, rtol=0, atol=1e-9)
    slope = np.sum(2 * (first - 2 * (2 * half - 1) * dry / stiffness))
    count = round((first - last) / (2 * dry / stiffness))
    np.testing.assert_allclose(rate, np.array([0.0, slope, 2 * count * last]), rtol=0, atol=1e-7)


@pytest.mark.long
def test_a_damper_and_smooth_resistance_share_what_the_body_loses():
    tube = jaxball.physics.mass_in_tube(0.5, (0.0, 0.0, 1.0), drive=Spring(20.0) + Damper(0.4))
    disk = Disk(mass=1.0, inertia=0.5, mechanisms=[tube], resistance=Resistance(rolling=0.1, dry=0.02))
    start = DiskState(phidot=-1.0, theta=[0.2], thetadot=[0.0])
    # Each time the disk turns back, dry resistance changes its sign within 0.01 m/s, between whose ends a step may
    # pass: at 1e-10 the state is off by 2e-10 or 2e-8, depending on where the steps fall.
    run = simulate(disk, [0.0, 1.0, 3.0], start, rtol=1e-12, atol=1e-12, dense=True)
    found = run.energy_losses()
    energy = np.asarray(run.observables.energy + 20.0 * run.state.theta[:, 0] ** 2 / 2)
    np.testing.assert_allclose(found.total, energy[0] - energy, rtol=0, atol=1e-9)
    assert min(found.dry[-1], found.viscous[-1], found.joints[-1, 0]) > 1e-2


def test_what_has_no_losses_is_refused():
    run = simulate(ball(), [0.0, 1.0])
    with pytest.raises(ValueError, match=r"must have dense output; call simulate\(..., dense=True\)"):
        run.energy_losses()
    top = classical.FreeRigidBody(inertia=(1.0, 2.0, 3.0))
    with pytest.raises(TypeError, match="of a Ball or a Disk, whose laws are known one by one, but it is of a Free"):
        simulate(top, [0.0, 1.0], classical.RigidBodyState(), dense=True).energy_losses()


@pytest.mark.long
def test_a_turntable_gives_back_what_is_not_lost():
    """A ball that spins at w on the axis of a table that turns at W: friction −c (w − W) loses c (w − W)², and the
    table does the work −c (w − W) W.
    """
    table, c, w, W = jaxball.Turntable(jaxball.ConstantRate(0.0, rate=2.0)), 0.05, 0.3, 2.0
    spun = ball(ground=jaxball.Ground(turntable=table), resistance=Resistance(spinning=c))
    run = simulate(spun, jnp.linspace(0.0, 1.0, 3), BallState(Omega=(0.0, 0.0, w)), **TIGHT)
    apart = (w - W) * np.exp(-np.asarray(run.times) * c / SOLID)
    np.testing.assert_allclose(run.observables.dissipation, c * apart**2, rtol=1e-9)
    np.testing.assert_allclose(run.observables.power, -c * apart * (W + apart), rtol=1e-9)
    lost = SOLID / 2 * (apart[0] ** 2 - apart**2)
    np.testing.assert_allclose(run.energy_losses().viscous, lost, rtol=1e-8, atol=1e-12)
    resting = ball(ground=jaxball.Ground(turntable=table), resistance=Resistance(dry=0.1, dry_spinning=0.1, exact=True))
    run = simulate(resting, jnp.linspace(0.0, 1.0, 3), BallState(Omega=(0.0, 0.0, W)), **TIGHT)
    np.testing.assert_array_equal(run.observables.dissipation, 0.0)
    np.testing.assert_array_equal(run.energy_losses().dry, 0.0)


@pytest.mark.long
def test_a_limit_surface_takes_what_the_spin_over_a_turntable_has():
    """A ball that spins on the axis of a table is turned at the rate μ m g ρ / I until it turns with the table."""
    mu, rho, w, W = 0.3, 0.02, 5.0, 2.0
    table = jaxball.Turntable(jaxball.ConstantRate(0.0, rate=W))
    law = Contact(jaxball.physics.LimitSurface(mu, rho))
    start = ReleasedState(BallState(Omega=(0.0, 0.0, w)), V=(0.0, 0.0, 0.0))
    run = simulate(ball(ground=jaxball.Ground(turntable=table)), jnp.linspace(0.0, 8.0, 5), start, contact=law, **TIGHT)
    apart = np.maximum(w - W - mu * M * G * rho / SOLID * np.asarray(run.times), 0.0)
    assert apart[1] > 0 == apart[-1]
    found = run.energy_losses()
    np.testing.assert_allclose(found.slip, SOLID / 2 * (apart[0] ** 2 - apart**2), rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(found.total, found.slip, rtol=0, atol=1e-12)
    np.testing.assert_allclose(run.state.Omega[:, 2], W + apart, rtol=1e-9)
