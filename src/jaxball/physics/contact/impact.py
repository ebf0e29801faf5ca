"""The impact of a body on the ground, with Newton's restitution and Coulomb's friction; ``transition`` computes it.

An impact takes no time: positions are unchanged, and so are the rates of joints that a schedule or a law moves. The
impulse I of the ground changes the slip velocity v_s by D I, and with it Ω and θ̇ of free joints as a slip acceleration
of this size would change their rates. Where slip and normal velocity are coupled by D, or D is not isotropic, the slip
turns, and may end and begin again, while the normal impulse grows. This is integrated as a process in the normal
impulse I₃,

    dv_s/dI₃ = D (e3 − μσ)        σ = v_s/|v_s|

(Routh's method; J. A. Batlle, Rough balanced collisions, J. Appl. Mech. 63 (1996) 168–172), with the slip velocity held
at zero where friction can do it.

The impact ends where v_s3 has become −e times its value before. It ends earlier if the total work of the normal force
reaches 0: all the energy of compression has then been returned, while Newton's e asks for more, as it may where
friction drives v_s3. So no impact with e ≤ 1 creates energy, because friction dissipates some. Rolling and spinning
friction give no impulse here, not even the dry one, which is proportional to N.
"""

from typing import TYPE_CHECKING, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ...numerics import cooper_verner
from ...numerics.directions import diverging
from ...numerics.vectors import apply, dot, inverse, root
from ..body import AbstractBody
from .friction import push, slip_direction
from .released import ReleasedState, Response, slip_velocity, with_slip

if TYPE_CHECKING:
    from .body_on_plane import BodyOnPlane

MOST_STEPS = 20_000
ERROR = 500  # of a step, in units of rounding of the velocity before, to which its length is chosen
TURNING = 0.5  # of the impulse in which v_s changes by its own size: the longest step while σ turns
LIMITED = 1e-3  # a rebound slower than Newton's by a smaller fraction, in square roots of rounding, counts as Newton's


def slowest_rise(plane: "BodyOnPlane", response: Response) -> Float[Array, ""]:
    """Computes the velocity at which a body leaves its ground, where a slower one counts as none: the law's ``slowest``
    times √(g r). Without gravity, the acceleration by which the body would fall takes the place of g.
    """
    g = jnp.abs(plane.body.gravity)
    return plane.law.slowest * root(jnp.where(g > 0, g, jnp.abs(response.free[2])) * plane.body.radius)


class _Care(NamedTuple):
    """The longest step, over the impulse in which v_s changes by its own size; the slip that counts as zero."""

    share: Float[Array, ""] | float
    still: Float[Array, ""] | float


# Where σ does not turn but would if something changed, a step of any length is exact for values, not for derivatives.
OF_VALUES, OF_DERIVATIVES = _Care(jnp.inf, 1e-12), _Care(0.15, 1e-8)


class Collision(NamedTuple):
    """What an impact does to the slip velocity, and the impulse that does it, contact axes.

    ``sticks``: whether it ends without slip. ``limited``: whether v_s3 at its end is less than Newton's restitution
    asks for, because the normal force would have to do work.
    """

    slip: Float[Array, "3"]
    impulse: Float[Array, "3"]
    sticks: Bool[Array, ""]
    limited: Bool[Array, ""]


class Impact(NamedTuple):
    """A state after an impact, with the collision. ``work`` is that of the ground, ½ I·(v_s⁺ + v_s⁻), not positive.

    Where nothing is moved by a schedule or a law, and no turntable turns, it is the change of the kinetic energy.
    """

    state: ReleasedState
    collision: Collision
    work: Float[Array, ""]


def impact(
    system: AbstractBody,
    t: Float[Array, ""],
    state: ReleasedState,
    response: Response,
    mu: Float[Array, ""],
    restitution: Float[Array, ""],
) -> Impact:
    """Computes the impact of a body that lands on the ground; nothing changes if it does not.

    ``response`` is its response just before, ``mu`` the coefficient of friction and ``restitution`` Newton's e.
    """
    before = slip_velocity(system, t, state)
    done = collision(response.delassus, before, mu, restitution)
    after = with_slip(system, state, response, before, done.slip)
    return Impact(after, done, 0.5 * dot(done.impulse, before + done.slip))


def collision(
    D: Float[Array, "3 3"], slip: Float[Array, "3"], mu: Float[Array, ""], restitution: Float[Array, ""]
) -> Collision:
    """Computes an impact at a contact with the matrix D, from the slip velocity before; nothing changes where
    ``slip[2]`` ≥ 0.

    In random cases, velocities after the impact had errors of less than 1e-10 of those before, in float64; where D is
    isotropic and does not couple slip and normal velocity, of rounding. NaN where the process does not end.
    """
    comes, eps = slip[2] < 0, float(jnp.finfo(slip.dtype).eps)
    after = jnp.where(comes, _after(D, slip, mu, restitution), slip)
    limited = after[2] < -restitution * slip[2] * (1 - LIMITED * eps**0.5)
    sticks = comes & jnp.all(after[:2] == 0)
    return Collision(after, apply(inverse(D), after - slip), sticks, comes & limited)


@jax.custom_jvp
def _after(
    D: Float[Array, "3 3"], slip: Float[Array, "3"], mu: Float[Array, ""], restitution: Float[Array, ""]
) -> Float[Array, "3"]:
    """Computes v_s after an impact."""
    return _after_process(D, slip, mu, restitution, OF_VALUES)


@_after.defjvp
def _after_jvp(primals, tangents):
    """Differentiates v_s after an impact by forward mode, which a loop of any length has."""
    return _after(*primals), jax.jvp(lambda *arguments: _after_process(*arguments, OF_DERIVATIVES), primals, tangents)[
        1
    ]


@jax.jit
def _after_process(D, slip, mu, restitution, care: _Care) -> Float[Array, "3"]:
    """Computes v_s after the process: by steps while it slips, straight on for what is left of the slip or of the
    impact.
    """
    process, eps = _Process(D, inverse(D), mu, -restitution * slip[2]), float(jnp.finfo(slip.dtype).eps)
    error, still = ERROR * eps * root(jnp.sum(slip**2)), care.still * root(jnp.sum(slip[:2] ** 2))

    def slips(x: Float[Array, "4"]) -> Bool[Array, ""]:
        return jnp.sum(x[:2] ** 2) > still**2

    def next_step(x: Float[Array, "4"]) -> Float[Array, ""]:
        most, remaining = process.longest(x, care.share, error), process.remaining(x)
        # A small rest is gone straight through after the loop. It is negative where a step went beyond the end, and the
        # next one then leads back.
        needed = slips(x) & (jnp.abs(remaining) > eps**0.5 * most)
        return jnp.where(needed, jnp.clip(remaining, -most, most), 0.0)

    def goes_on(carry):
        _, h, count = carry
        return (h != 0) & (count < MOST_STEPS)

    def advance(carry):
        x, h, count = carry
        x = cooper_verner.step(process.slope, x, h)
        return x, next_step(x), count + 1

    x = jnp.append(slip, 0.0)
    first = jnp.where(slip[2] < 0, next_step(x), 0.0)
    x, h, _ = jax.lax.while_loop(goes_on, advance, (x, first, jnp.zeros((), int)))
    # The slip may end before the impact does; whichever comes first, σ hardly turns until then.
    # Without friction nothing sticks, whose derivatives are then those of a slip.
    remaining, stop = process.remaining(x), jnp.where(slips(x) | (mu == 0), process.stop(x), 0.0)
    ends = remaining < stop
    x = process.straight(x, jnp.where(ends, remaining, stop))
    holds = ends | process.holds
    after = jax.lax.cond(holds, lambda x: jnp.where(ends, x[:3], process.stick(x)), process.again, x)
    # Steps were left to take when their number ran out: an unfinished impact must not pass for one.
    return after * jnp.where(h == 0, 1.0, jnp.nan)


class _Process(NamedTuple):
    """Routh's process. Its state x is v_s, and the work of the normal force so far, ∫ v_s3 dI₃.

    ``target`` is v_s3 at its end, and ``S`` the inverse of D.
    """

    D: Float[Array, "3 3"]
    S: Float[Array, "3 3"]
    mu: Float[Array, ""]
    target: Float[Array, ""]

    def pull(self, sigma: Float[Array, "2"]) -> Float[Array, "3"]:
        """Computes dv_s/dI₃ = D (e3 − μσ)."""
        return apply(self.D, push(self.mu, sigma))

    def slope(self, x: Float[Array, "4"]) -> Float[Array, "4"]:
        """Computes dx/dI₃."""
        return jnp.concatenate([self.pull(_direction(x)), x[2:3]])

    def straight(self, x: Float[Array, "4"], h: Float[Array, ""]) -> Float[Array, "4"]:
        """Computes x after the normal impulse ``h`` if σ stays as it is."""
        pull = self.pull(_direction(x))
        return x + jnp.append(h * pull, h * x[2] + 0.5 * h**2 * pull[2])

    def longest(
        self, x: Float[Array, "4"], share: Float[Array, ""] | float, error: Float[Array, ""]
    ) -> Float[Array, ""]:
        """Chooses a step with this error of v_s, which is smaller the less σ turns; at most a fraction of v_s."""
        D, sigma = self.D, _direction(x)
        pull = self.pull(sigma)[:2]
        turning = jnp.abs(sigma[0] * pull[1] - sigma[1] * pull[0])
        # The difference of the principal values of D along the ground bounds how far the pull changes with σ: so a
        # step is short enough also where σ is about to turn.
        uneven = root((D[0, 0] - D[1, 1]) ** 2 + 4 * D[0, 1] ** 2)
        fastest = jnp.maximum(root(jnp.sum(pull**2)), root(jnp.sum(D[:2, 2] ** 2)) + self.mu * uneven)
        speed = root(jnp.sum(x[:2] ** 2))
        moved, turns = fastest > 0, turning * speed > error * fastest
        # The error of a step of the method of order 8 grows as the ninth power of its length.
        allowed = 3 * (error * fastest / jnp.where(turns, turning * speed, 1.0)) ** (1 / 9)
        part = jnp.where(turns, jnp.minimum(jnp.minimum(share, TURNING), allowed), share)
        length = part * speed / jnp.where(moved, fastest, 1.0)
        return jnp.where(moved, length, jnp.inf)

    def remaining(self, x: Float[Array, "4"]) -> Float[Array, ""]:
        """Computes the normal impulse until the end if σ stays as it is; infinite while friction drives the
        body down.
        """
        rise = self.pull(_direction(x))[2]
        rises = rise > 0
        rise = jnp.where(rises, rise, 1.0)
        return jnp.where(rises, (self.end(x, rise) - x[2]) / rise, jnp.inf)

    def end(self, x: Float[Array, "4"], rise: Float[Array, ""]) -> Float[Array, ""]:
        """Computes v_s3 at the end, where dv_s3/dI₃ stays ``rise``: as restitution has it, or where the work has become
        0.
        """
        # Until v_s3 is v, the normal force does the further work (v² − v_s3²) / (2 rise).
        return jnp.minimum(self.target, root(x[2] ** 2 - 2 * rise * x[3]))

    def stop(self, x: Float[Array, "4"]) -> Float[Array, ""]:
        """Computes the normal impulse until the slip ends, if σ stays as it is; infinite where it does not."""
        sigma = _direction(x)
        braking = -jnp.sum(sigma * self.pull(sigma)[:2])
        brakes = braking > 0
        return jnp.where(brakes, root(jnp.sum(x[:2] ** 2)) / jnp.where(brakes, braking, 1.0), jnp.inf)

    @property
    def holds(self) -> Bool[Array, ""]:
        """Whether friction holds a contact that does not slip while the normal impulse grows."""
        # The impulse that changes v_s3 alone is along the third column of D⁻¹; it must be inside the cone of friction.
        return jnp.sum(self.S[:2, 2] ** 2) <= (self.mu * self.S[2, 2]) ** 2

    def stick(self, x: Float[Array, "4"]) -> Float[Array, "3"]:
        """Computes v_s at the end of an impact that sticks from x on."""
        return jnp.zeros_like(x[:3]).at[2].set(self.end(x, 1 / self.S[2, 2]))

    def again(self, x: Float[Array, "4"]) -> Float[Array, "3"]:
        """Computes v_s at the end of an impact whose slip has ended at x and begins again; NaN if the body
        never rises.
        """

        def pull(process: _Process, sigma: Float[Array, "2"]) -> tuple[Float[Array, "2"], Float[Array, ""]]:
            return process.pull(sigma)[:2], jnp.ones_like(process.mu)

        sigma, growth = diverging(pull, self, -self.S[:2, 2])
        rise = self.pull(sigma)[2]
        rises = rise > 0
        end = self.end(x, rise)
        h = (end - x[2]) / jnp.where(rises, rise, 1.0)
        return jnp.where(rises, jnp.append(h * growth * sigma, end), jnp.nan)


def _direction(x: Float[Array, "4"]) -> Float[Array, "2"]:
    return slip_direction(x[:3], jnp.zeros_like(x[:2]))
