"""A ball that rolls, slips or flies over a surface: Newton's and Euler's laws, and the nearest piece of the surface."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import minimize

from jaxball import Bowl, CarriedMass, Contact, HeightField, Hinge, Mechanism, Resistance, Spring, programs
from jaxball.physics import Mode, ReleasedState
from jaxball.physics.contact.body_on_plane import BodyOnPlane
from jaxball.physics.contact.modes import ContactState
from jaxball.physics.contact.released import release, with_rise
from jaxball.physics.contact.window import Beginning
from tests.physics.test_grounds import SHAPES, hills, loaded, moved, moving_frame, sphere, states, swelling
from tests.support.on_surfaces import released_residuals

# Residuals are sums of some ten terms of the order of 100.
ROUNDING = 2e-11
HEIGHT = 0.4


def in_mode(ball, t, state, mode, rng):
    """A state in a mode, with a random slip or a random flight."""
    given = release(ball, t, state)
    if mode == Mode.SLIDING:
        given = ReleasedState(state, given.V + rng.normal(size=3))
        given = ReleasedState(state, with_rise(ball, t, given, jnp.zeros(())))
    if mode == Mode.FLIGHT:
        given = ReleasedState(state, rng.normal(size=3), HEIGHT)
    zero = jnp.zeros(())
    begun = Beginning.none(zero)
    return ContactState(given.body, given.V, given.height, zero, zero, zero + int(mode), begun, given.body.z)


def require_balances(ball, place, states, torque=None):
    plane, rng = BodyOnPlane(ball, Contact(0.3)).prepare(), np.random.default_rng(3)
    laws = programs.filter_jit(lambda t, state: released_residuals(plane, t, state, place, torque))
    packing = programs.filter_jit(lambda t, state: plane.from_packed(t, plane.to_packed(t, state)))
    for t, state in zip((0.3, 1.7), states, strict=True):
        for mode in (Mode.ROLLING, Mode.SLIDING, Mode.FLIGHT):
            full = in_mode(ball, jnp.asarray(t), state, mode, rng)
            for name, left in laws(jnp.asarray(t), full)._asdict().items():
                assert np.max(np.abs(left)) < ROUNDING, (mode, name)
            for one, other in zip(jax.tree.leaves(packing(jnp.asarray(t), full)), jax.tree.leaves(full), strict=True):
                np.testing.assert_allclose(one, other, atol=1e-12)


@pytest.mark.long
def test_momenta_balance_on_a_ground_that_moves_and_deforms_under_a_free_joint():
    arm = Mechanism([Hinge((0.0, 1.0, 0.0), drive=Spring(stiffness=2.0))], [CarriedMass(0.3, (0.1, 0.0, -0.5))])
    ball = loaded(HeightField(swelling, 0.15, motion=moving_frame()), mechanisms=[arm])

    def place(t, u1, u2):
        return moved(t, jnp.stack([u1, u2, swelling(t, u1, u2, 0.15)]))

    def turned(state):
        return eqx.tree_at(lambda s: (s.theta, s.thetadot), state, (jnp.array([0.4]), jnp.array([-0.7])))

    require_balances(ball, place, map(turned, states(2)))


@pytest.mark.thorough
def test_momenta_balance_on_hills():
    require_balances(loaded(HeightField(hills)), lambda t, x, y: jnp.stack([x, y, hills(t, x, y, None)]), states(2))


@pytest.mark.long
@pytest.mark.parametrize("name", ["inside an ellipsoid", "parametric", "tilting plane"])
def test_momenta_balance_on_a_surface(name):
    """The other ones differ by their places alone, of which the tests of rolling on each of them tell."""
    ground, place = SHAPES[name]
    require_balances(loaded(ground), place, states(2))


@pytest.mark.long
def test_momenta_balance_with_rolling_friction_of_a_ball_that_slips():
    """Viscous and dry torques resist the turning relative to the ground's matter, and none does in flight."""
    resistance = Resistance(rolling=0.3, spinning=0.2, dry=0.05, smoothing=0.1)

    def torque(t, state, N):
        place = sphere(1.0)(t, *state.z)
        n = (jnp.array([0.0, 0.0, 3.0]) - place) / 3.0
        omega = state.Lambda @ state.Omega
        rolls = omega - (omega @ n) * n
        return -0.3 * rolls - 0.2 * (omega @ n) * n - 0.05 * N * rolls / jnp.sqrt(rolls @ rolls + 0.1**2)

    require_balances(loaded(Bowl(3.0), resistance=resistance), sphere(1.0), states(2), torque)


@pytest.mark.thorough
@pytest.mark.parametrize("name", SHAPES)
def test_nearest_piece_of_each_surface(name):
    """Of points off the surface at both sides, found from some way off; the least distance is that of SciPy.

    Its derivatives are those of differences, as the foot moves with the point.
    """
    ground, place = SHAPES[name]
    rng, t = np.random.default_rng(5), jnp.asarray(0.7)
    foot = programs.filter_jit(lambda c, near: ground.foot(t, c, near))
    slopes = programs.filter_jit(jax.jacfwd(lambda c, near: ground.foot(t, c, near)))
    distance = programs.filter_jit(jax.value_and_grad(lambda u, c: 0.5 * jnp.sum((place(t, *u) - c) ** 2)))
    for off in (0.5, -0.3):
        u = jnp.asarray(0.5 * rng.normal(size=2))
        c = place(t, *u) + off * ground.normal(t, u)
        near = u + 0.2 * rng.normal(size=2)
        found = foot(c, near)
        best = minimize(distance, near, args=(c,), jac=True, options={"gtol": 1e-12})
        np.testing.assert_allclose(found, best.x, atol=1e-6)
        np.testing.assert_allclose(found, u, atol=1e-12)
        h = 1e-5
        columns = [(foot(c + h * e, near) - foot(c - h * e, near)) / (2 * h) for e in np.eye(3)]
        np.testing.assert_allclose(slopes(c, near), np.stack(columns, axis=1), atol=1e-8)


def test_a_frame_is_undone():
    frame, t, x = moving_frame(), jnp.asarray(1.3), jnp.array([0.3, -1.2, 0.7])
    np.testing.assert_allclose(frame.undo(t, frame.place(t, x)), x, atol=1e-14)
    np.testing.assert_allclose(frame.place(t, x), moved(t, x), atol=1e-14)


@pytest.mark.thorough
def test_nearest_piece_where_the_search_must_not_follow_the_slope_of_a_saddle():
    """From far over the top of a wave, to one of the two feet at its sides, which are equally near."""
    ground = HeightField(lambda t, x, y, _: 0.5 * jnp.cos(2.0 * x))
    c = jnp.array([0.05, 0.3, -3.0])  # under it, beyond its centre of curvature
    u = ground.foot(jnp.asarray(0.0), c, jnp.zeros(2))
    distance = np.hypot(u[0] - 0.05, 0.5 * np.cos(2.0 * u[0]) + 3.0)
    x = np.linspace(-3.0, 3.0, 200_001)
    assert distance == pytest.approx(np.min(np.hypot(x - 0.05, 0.5 * np.cos(2.0 * x) + 3.0)), abs=1e-8)
