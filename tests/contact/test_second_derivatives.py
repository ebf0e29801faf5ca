"""Second derivatives through slips, bounces, rest and joints that stick, against motions that are known in closed form.

Within modes the motions are polynomials of the time, so that 1e-9 of the size of a row of them is ten times the
tolerance. All of them are derivatives along two directions at once, which is one number for each result and one program
for each run: a wrong entry of the matrix of second derivatives would be seen.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import Ball, BallState, Contact, Disk, DiskState, JointFriction, Resistance
from jaxball.physics import ReleasedState
from tests.support.orders import ORDERS

R, END = 0.3, 1.4


def along(function, p, one, other):
    """The derivative of a function along two directions."""
    return jax.jvp(lambda p: jax.jvp(function, (p,), (one,))[1], (p,), (other,))[1]


def slide(p):
    """A solid ball that slides and then rolls: when that is, and where it is at the end."""
    v, mu, g = p
    ball = Ball(mass=1.0, inertia=(0.4,) * 3, gravity=g)
    start = ReleasedState(BallState(), jnp.stack([v, 0 * v, 0 * v]))
    run = jaxball.simulate(ball, [0.0, END], start, contact=Contact(mu))
    return jnp.stack([run.contact.switches.times[0], run.state.z[-1, 0]])


def slide_in_closed_form(p):
    v, mu, g = p
    return jnp.stack([2 * v / (7 * mu * g), 5 * v * END / 7 + 2 * v**2 / (49 * mu * g)])


def bounce(p):
    """A ball that is dropped: when it bounces, and its height and speed after four bounces."""
    h, g, e = p
    run = jaxball.simulate(
        Ball(mass=1.0, inertia=(0.4,) * 3, gravity=g),
        [0.0, END],
        ReleasedState(BallState(), jnp.zeros(3), h),
        contact=Contact(0.3, restitution=e, slowest=0.01),
    )
    last = jnp.stack([run.contact.height[-1], run.contact.V[-1, 2]])
    return jnp.concatenate([run.contact.switches.times[:4], last])


def bounce_in_closed_form(p):
    h, g, e = p
    times = jnp.sqrt(2 * h / g) * jnp.stack([1 + 2 * sum(e**k for k in range(1, n)) for n in range(1, 5)])
    speed, since = e**4 * jnp.sqrt(2 * g * h), END - times[-1]
    return jnp.append(times, jnp.stack([speed * since - g * since**2 / 2, speed - g * since]))


def rest(p):
    """A solid ball that exact dry resistance stops: when and where."""
    v, c, g = p
    ball = Ball(mass=1.0, radius=R, inertia=(0.4 * R**2,) * 3, gravity=g, resistance=Resistance(dry=c, exact=True))
    run = jaxball.simulate(ball, [0.0, 20.0], BallState(Omega=jnp.stack([0 * v, v / R, 0 * v])))
    return jnp.stack([run.switches.times[0], run.state.z[-1, 0]])


def rest_in_closed_form(p):
    v, c, g = p
    return jnp.stack([7 * v / (5 * c * g), 7 * v**2 / (10 * c * g)])


MASS, INERTIA, RING = 2.0, 0.09, 0.5


def stick(p):
    """A rotor whose friction sets its disk rolling until it sticks: when that is, and where the disk is at the end."""
    spin, q, radius = p
    rotor = jaxball.ring_rotor(RING, radius, axis=(0.0, 1.0, 0.0), drive=JointFriction(q))
    disk = Disk(mass=MASS, inertia=INERTIA, radius=R, gravity=9.81, mechanisms=[rotor])
    run = jaxball.simulate(disk, [0.0, 2.0], DiskState(theta=[0.0], thetadot=spin[None]))
    return jnp.stack([run.switches.times[0], run.state.z[-1]])


def stick_in_closed_form(p):
    spin, q, radius = p
    of_disk, of_rotor = INERTIA + (MASS + RING) * R**2, RING * radius**2
    stops = spin / (q * (1 / of_disk + 1 / of_rotor))
    rate = q * stops / of_disk
    return jnp.stack([stops, R * rate * (stops / 2 + 2.0 - stops)])


CASES = {
    "a slip": (slide, slide_in_closed_form, (2.0, 0.3, 9.81)),
    "bounces": (bounce, bounce_in_closed_form, (0.5, 9.81, 0.7)),
    "rest": (rest, rest_in_closed_form, (1.0, 0.05, 9.81)),
    "a joint": (stick, stick_in_closed_form, (6.0, 0.1, 0.2)),
}


@pytest.mark.long
@pytest.mark.parametrize("case", CASES)
def test_second_derivatives_are_those_of_closed_forms(case):
    function, closed_form, p = CASES[case]
    p = jnp.array(p)
    one, other = p * jnp.array([0.7, -1.1, 0.9]), p * jnp.array([1.2, 0.6, -0.8])
    value, curvature = jaxball.jit(lambda p: (function(p), along(function, p, one, other)))(p)
    expected = np.asarray(closed_form(p))
    np.testing.assert_allclose(value, expected, rtol=1e-9)
    entries = jax.jacfwd(jax.jacfwd(closed_form))(p)
    size = jnp.einsum("kij,i,j->k", jnp.abs(entries), jnp.abs(one), jnp.abs(other))
    error = np.abs(curvature - jnp.einsum("kij,i,j->k", entries, one, other))
    assert np.all(error < 1e-9 * size)


@pytest.mark.slow
@pytest.mark.parametrize("twice", list(ORDERS.values()), ids=list(ORDERS))
def test_both_modes_in_any_order_give_them(twice):
    """Of a slip; by the coefficient twice it is 4v²/(49 μ³ g), by the speed twice 4/(49 μ g)."""
    p = jnp.array([2.0, 0.3, 9.81])
    found, expected = jax.jit(twice(slide))(p), jax.jacfwd(jax.jacfwd(slide_in_closed_form))(p)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 * np.max(np.abs(expected)))
    np.testing.assert_allclose(found[1, 1, 1], 4 * 2.0**2 / (49 * 0.3**3 * 9.81), rtol=1e-9)
    np.testing.assert_allclose(found[1, 0, 0], 4 / (49 * 0.3 * 9.81), rtol=1e-9)
