"""How a slip begins and how it ends, where its direction σ = v_s/|v_s| cannot be computed from its velocity.

It may be a slide, which has a third component ρ ω₃ where friction has a limit surface.

With the angle φ of σ and the speed s, a slip obeys ṡ = a·σ and s φ̇ = a·n, where n is σ turned by a right angle and
the slip acceleration a = v̇_s is a smooth function of φ and of the motion of the rest. Both ends, s = 0, are singular.

**A slip begins**, and stays slow, as ``window`` says.

**A slip ends** in a finite time, in which its direction turns ever faster. In the time τ with dt = s dτ nothing is
singular: φ′ = a·n, (ln s)′ = a·σ, t′ = s. Where the slip is slow, the rest hardly moves until the end, and the slip is
followed to its end with the response of the body halfway.

**Rolling** under exact dry resistance begins and ends in the same way, with ω_h in place of v_s. A ball rolls in the
direction of ω_h until that vanishes, and rests until the torque that holds it exceeds the largest one; spinning, ω₃,
has a mode of rest of its own. A disk has two directions, which its state knows. All vectors are in contact axes: on a
plane those of space.
"""

import dataclasses
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ...numerics import cooper_verner
from ...numerics.directions import perpendicular, turn_left, unit
from ...numerics.vectors import root
from ..body import AbstractBody
from ..dynamics.dry_friction import Needs
from ..hybrid import Accuracy, GuardedStep
from .friction import SolvedContact
from .window import Course

if TYPE_CHECKING:
    from .body_on_plane import BodyOnPlane

NEARLY_STILL = 3  # times the least speed of a slip: a slower one may end in the next step
SAME_SPEED = 1e-9  # of a speed: what rounding may change
PAST = 0.5  # of the least speed: a step is to end no slower than that
TRUNCATED = 2e5  # tolerances: the largest error of a step, relative to the speed of a slip that ends, for derivatives
SLOW = 0.3  # power of rounding: a slip slower than this share of a body's speed is followed by `end`, not by steps
UNTOLD = 10  # errors of the speed: steps cannot tell the direction of so slow a slip
ERRORS = 30  # errors of the speed, by which a slip at its end may exceed twice the least one
LONGEST_PAUSE = 0.25  # power of rounding: the longest time, in √(r/g), over which a slip is followed to its end
COARSER = 0.3  # times the cube root of the tolerance: the same if that is loose, as the error is cubic in the time
HALFWAY = 0.5  # through the time, and the speed, of a slip that ends
STEPS_TO_END = 16  # in the time τ, to the end of a slip
TURN = 1.5  # by which σ turns and ln s falls in one of them, at most


class Heading(NamedTuple):
    """The direction σ of a slip as a step begins, and along it its ``speed``; slower than ``least``, it soon ends."""

    sigma: Float[Array, " n"]
    speed: Float[Array, ""]
    least: Float[Array, ""]

    @classmethod
    def of(
        cls,
        sigma: Float[Array, " n"],
        slip: Float[Array, " n"],
        size: Float[Array, ""],
        errors: Float[Array, ""],
        power: float,
    ) -> "Heading":
        """Returns the heading of a slip in the direction σ: ``size`` is the size of velocities, ``errors`` the size of
        their errors, and ``power`` that of rounding which is slow.
        """
        speed = jnp.maximum(jnp.sum(slip * sigma), 0.0)
        # The guard of a slip is its speed along σ less ``least``: with at most half the speed, it is positive as a step
        # begins.
        least = jnp.maximum(float(jnp.finfo(speed.dtype).eps) ** power * size, UNTOLD * errors)
        return cls(sigma, speed, jnp.minimum(least, 0.5 * speed))


class Pull(NamedTuple):
    """What acts on a slip in some direction σ.

    ``acceleration`` is a, ``power`` that of friction over the speed, and ``normal`` the normal force.
    """

    acceleration: Float[Array, " n"]
    power: Float[Array, ""]
    normal: Float[Array, ""]


class Around(NamedTuple):
    """What a slow slip depends on, which changes linearly with the time: ``now``, and what it is ``later``, after the
    time ``span``; None where it is constant.
    """

    now: Any
    later: Any = None
    span: Any = None

    def at(self, time: Float[Array, ""]) -> Any:
        """Returns what it is after some time."""
        if self.later is None:
            return self.now
        share = jnp.where(self.span > 0, time / jnp.where(self.span > 0, self.span, 1.0), 0.0)

        def between(x: Array, later: Array) -> Array:
            return x + share * (later - x) if jnp.issubdtype(x.dtype, jnp.inexact) else x

        return jax.tree.map(between, self.now, self.later)


def pull_of_friction(
    about: tuple[SolvedContact, Float[Array, "3"]], sigma: Float[Array, " n"], slower: Float[Array, ""]
) -> Pull:
    """Computes how a body slips, where ``slower`` is the share of its speed that is left and the coefficient μ a
    polynomial in that.
    """
    contact, mu = about
    acting = contact.interaction(mu[0] + slower * (mu[1] + slower * mu[2]), sigma)
    return Pull(acting.slide_acceleration, -jnp.sum(sigma * acting.grip[:-1]), acting.normal)


class End(NamedTuple):
    """The end of a slow slip: whether it ends, in which time, and what happens until then.

    ``friction_loss`` is the work of friction, ``way`` the integral of v_s, ``normal`` the mean normal force, and
    ``late_normal`` that with weights that rise from 0 at the beginning to 2 at the end.
    """

    comes: Bool[Array, ""]
    time: Float[Array, ""]
    friction_loss: Float[Array, ""]
    way: Float[Array, " n"]
    normal: Float[Array, ""]
    late_normal: Float[Array, ""]

    def braking(self, slip: Float[Array, " n"]) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
        """Computes the mean slip acceleration, by which a slip is exactly zero in the end, and that with the weights of
        ``late_normal``.
        """
        ends = self.time > 0
        time = jnp.where(ends, self.time, 1.0)
        return jnp.where(ends, -slip / time, 0.0), -2 * self.way / time**2


@partial(jax.jit, static_argnums=0)
def end(
    pull: Callable[[Any, Float[Array, " n"], Float[Array, ""]], Pull], around: Around, slip: Float[Array, " n"]
) -> End:
    """Computes the end of a slow slip, during which what is ``around`` it changes little.

    It ends if the direction to which the slip turns is one in which it slows down.
    """
    # In the time τ, x is: σ, the logarithm of the share of the speed that is left, and integrals over the time: 1 and N
    # over the speed, the work of friction, v_s and t N over its square. So x hardly depends on how slow the slip is.
    speed, n = root(jnp.sum(slip**2)), slip.size
    still = jax.lax.stop_gradient(around.now)

    @jax.jit
    def motion(x: Float[Array, " size"]) -> Float[Array, " size"]:
        sigma, slower, time = unit(x[:n]), jnp.exp(x[n]), x[n + 1]
        acting = pull(around.at(speed * time), sigma, slower)
        a, pressing = acting.acceleration, acting.normal * slower
        rest = jnp.stack([jnp.sum(sigma * a), slower, pressing, acting.power * slower**2, time * pressing])
        return jnp.concatenate([perpendicular(sigma, a), rest, slower**2 * sigma])

    def fastest(x: Float[Array, " size"]) -> Float[Array, ""]:
        sigma, slower = unit(x[:n]), jnp.exp(x[n])
        if n == 2:
            acting, turned = jax.jvp(lambda sigma: pull(still, sigma, slower), (sigma,), (turn_left(sigma),))
            return root(jnp.sum(acting.acceleration**2)) + root(jnp.sum(turned.acceleration**2))
        # No less than what any turn changes: the whole derivative counts.
        acting, slopes = pull(still, sigma, slower), jax.jacfwd(lambda x: pull(still, x, slower).acceleration)(sigma)
        return root(jnp.sum(acting.acceleration**2)) + root(jnp.sum(slopes**2))

    def advance(x: Float[Array, " size"], _: None) -> tuple[Float[Array, " size"], None]:
        # How fast σ may turn, which decides the step and is no part of the result, so it has no derivatives.
        rate = fastest(jax.lax.stop_gradient(x))
        h = jnp.where(rate > 0, TURN / jnp.where(rate > 0, rate, 1.0), 0.0)
        return cooper_verner.step(motion, x, h), None

    start = jnp.concatenate([unit(slip), jnp.zeros((5 + n,), slip.dtype)])
    x = jax.lax.scan(advance, start, None, length=STEPS_TO_END)[0]
    # By now σ hardly turns: from here on the slip slows down uniformly, in the time slower / −growth.
    growth, slower, pressing, power = motion(x)[n : n + 4]
    comes = (growth < 0) & (x[n] < 0)
    left_of_it = 1 / jnp.where(comes, -growth, 1.0)
    until_end = slower * left_of_it
    time, impulse = x[n + 1] + until_end, x[n + 2] + pressing * left_of_it
    friction_loss = x[n + 3] + 0.5 * power * left_of_it
    moment = x[n + 4] + pressing * left_of_it * (x[n + 1] + 0.5 * until_end)
    way, whole = x[n + 5 :] + 0.5 * slower * until_end * unit(x[:n]), jnp.where(time > 0, time, 1.0)
    return End(comes, speed * time, speed**2 * friction_loss, speed**2 * way, impulse / whole, 2 * moment / whole**2)


def longest_pause(tolerance: Float[Array, ""], unit_of_time: Float[Array, ""]) -> Float[Array, ""]:
    """Computes the longest time over which a slip is followed to its end by :func:`end`."""
    eps = float(jnp.finfo(unit_of_time.dtype).eps)
    return jnp.maximum(eps**LONGEST_PAUSE, COARSER * jnp.cbrt(tolerance)) * unit_of_time


def unit_of_time(body: AbstractBody) -> Float[Array, ""]:
    """Computes √(r/g); √r without gravity."""
    g = jnp.abs(body.gravity)
    return root(body.radius / jnp.where(g > 0, g, 1.0))


def nears_its_end(before: Float[Array, ""], after: Float[Array, ""], least: Float[Array, ""]) -> Bool[Array, ""]:
    """Returns whether a step has slowed down a slip that was slow when it began, so that its end may have come.

    Where friction is hardly needed to hold the body, the direction of a slow slip returns to that in which it ends much
    faster than the slip slows down. Steps are then too short to halve its speed, and would never meet a zero of the
    guard.
    """
    # ``Heading.of`` limits ``least`` to half the speed: equality, up to rounding, says that this limit was in force.
    return (before <= (2 + SAME_SPEED) * least) & (after < before)


def longest_step(
    before: Float[Array, ""],
    after: Float[Array, ""],
    least: Float[Array, ""],
    length: Float[Array, ""],
    accuracy: Accuracy,
) -> Float[Array, ""]:
    """Computes the longest next step after one of this length in which a slip has slowed down; infinite where it has
    not.

    It is a fraction of the time until the end of the slip, where the direction turns ever faster, and goes beyond the
    least speed at most half way to the end, because the stages of a step across the end pull in both directions, which
    a low-order method may not notice as an error.
    """
    # Close to the end, the error of a step grows as its share of the time until then, to the power of order + 1.
    share = jnp.minimum((TRUNCATED * accuracy.tolerance) ** (1 / (accuracy.order + 1)), accuracy.approach)
    slows = (after > 0) & (before > after)
    until_end = after * length / jnp.where(slows, before - after, 1.0)
    safe = 1 - PAST * least / jnp.where(slows, after, 1.0)
    longest = until_end * jnp.where(after > NEARLY_STILL * least, jnp.minimum(share, safe), safe)
    return jnp.where(slows & (longest > 0), longest, jnp.inf)


SLOW_TURNING = 0.4  # as slip.SLOW, for rolling, which is followed to its end with what acts halfway
ERRORS_OF_ROLLING = 50  # tolerances: how fast a ball may roll to and fro by the errors of a method of low order
LONGEST_WAY = 10  # in tolerances: the angle over which a ball is followed to its rest however long that takes, ...
STEADY_RESPONSE = 0.2  # ... if what acts halfway changes the time until then by no more than this share


def heading_of_rolling(plane: "BodyOnPlane", t: Float[Array, ""], state: Any, accuracy: Accuracy) -> Heading:
    """Returns the direction of rolling as a step begins; a disk may roll however slowly."""
    sigma, omega = plane.direction(t, state), plane.over_ground(t, state)
    size = root(jnp.sum(omega**2))
    g, r, rate = jax.lax.stop_gradient((jnp.abs(plane.body.gravity), plane.body.radius, size))
    heading = Heading.of(sigma, omega[:2], root(g / r) + rate, accuracy.atol + accuracy.rtol * size, SLOW_TURNING)
    # The direction of a disk's rolling does not turn as that ends, so nothing has to stop short of zero.
    return heading._replace(least=jnp.zeros_like(heading.least)) if plane.body.planar else heading


def guards_of_turning(
    plane: "BodyOnPlane", t: Float[Array, ""], state: Any, spare: Needs, heading: Heading
) -> Float[Array, "2"]:
    """Computes the rate in the direction of rolling, and of spinning, or what friction that holds has to spare."""
    omega = plane.over_ground(t, state)
    # A guard that the body does not have is always positive.
    rolling = spinning = jnp.ones_like(state.rolls)
    if plane.resists_rolling:
        forward = jnp.sum(omega[:2] * heading.sigma) - heading.least
        rolling = jnp.where(state.rolls == 0, spare.rolling, forward)
    if plane.resists_spinning:
        spinning = jnp.where(state.spin == 0, spare.spinning, state.spin * omega[2])
    return jnp.stack([rolling, spinning])


def comes_to_rest(
    plane: "BodyOnPlane", first: End, second: End, omega: Float[Array, "2"], tolerance: Float[Array, ""]
) -> Bool[Array, ""]:
    """Returns whether a ball that rolls slowly, with ω_h over the ground, has come to rest at its ``first`` end.

    Where resistance is hardly enough to hold it, a ball no faster than the errors of its speed takes long to stop.
    It does all the same, if it turns little until then, and if what acts halfway, by which its end is the
    ``second``, is much the same.
    """
    is_soon = first.time <= longest_pause(tolerance, unit_of_time(plane.body))
    is_short = root(jnp.sum(omega**2)) * first.time <= LONGEST_WAY * tolerance
    is_steady = second.comes & (jnp.abs(second.time - first.time) <= STEADY_RESPONSE * first.time)
    return first.comes & (is_soon | (is_short & is_steady))


def follow_rolling(
    plane: "BodyOnPlane", t: Float[Array, ""], before: Any, state: Any, tolerance: Float[Array, ""]
) -> tuple[Course, Bool[Array, ""]]:
    """Returns how a ball rolls, and whether it does although its direction is not known beforehand.

    - ``before``: the state before an event, by whose window the direction may be known at its end.
    """
    omega, sigma = plane.over_ground(t, state), plane.direction(t, before)
    course = Course(sigma, jnp.sum(sigma * omega[:2]), before.rolling.next_span(t))
    size = _unit_of_rate(plane) + root(jnp.sum(omega**2))
    rolls = (state.rolls != 0) & (before.rolls != 0) & (state.rolling.until <= t) & plane.resists_rolling
    return course, rolls & course.is_that_of(omega[:2], size, tolerance)


def along_rolling(plane: "BodyOnPlane", t: Float[Array, ""], state: Any, course: Course) -> Any:
    """Returns the state with ω_h exactly along its direction, without the errors of the solve across it."""
    omega = plane.over_ground(t, state).at[:2].set(course.slip)
    Omega = plane.contact_axes(t, state).in_body(omega)
    return dataclasses.replace(state, body=state.body.with_Omega(Omega))


def _unit_of_rate(plane: "BodyOnPlane") -> Float[Array, ""]:
    """Computes √(g/r)."""
    return root(jax.lax.stop_gradient(jnp.abs(plane.body.gravity) / plane.body.radius))


def approach_rest(
    plane: "BodyOnPlane", step: GuardedStep, heading: Heading, guard: int, accuracy: Accuracy
) -> tuple[Bool[Array, ""], Bool[Array, ""], Float[Array, ""]]:
    """Returns whether a ball that rolls is slow, whether it may come to its end, and the longest next step.

    - ``guard``: the index of the guard of rolling.
    """
    least, omega = heading.least, plane.over_ground(step.end, step.state)
    # Within the errors of the method the ball rolls to and fro, so that it may never be as slow as ``least``.
    slowest = least + ERRORS_OF_ROLLING * (accuracy.atol + accuracy.rtol * root(jnp.sum(omega**2)))
    slow = root(jnp.sum(omega[:2] ** 2)) <= 2 * slowest
    before, after = step.guards[guard, 0] + least, step.guards[guard, -1] + least
    nears = slow & nears_its_end(before, after, slowest)
    return slow, nears, longest_step(before, after, least, step.end - step.start, accuracy)
