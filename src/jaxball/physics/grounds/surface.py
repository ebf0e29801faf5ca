"""The contract of a surface on which a ball rolls, and what follows from it where the ball touches it.

With p the foot, the point of the ground under the centre c = p + r n, n its normal towards the ball, w the velocity of
its matter there and u its two coordinates on the ground, rolling is ċ = w + r ω × n, and so

    (∂c/∂u) u̇ = ċ − ∂c/∂t        c̈ = r ω̇ × n + [ẇ + r ω × ṅ]

with rates along the motion of the contact point. The bracket is known at a state.
"""

import abc
from collections.abc import Iterator
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ...interface.arguments import require
from ...interface.status import Status
from ...numerics.vectors import add, cross, dot, unit_vector
from ..conditions import Condition, ExplainedCondition, Problem
from .carriers import MovingFrame, Slopes
from .chart import END_MARGIN, LEAST_MARGIN, Chart, Section, Touch, determinant, margin, nearest
from .ground import AbstractGround, Footing

CURVED = (
    "curved less than the ball where it starts, on the side of the ball, because a ball that is more curved than its "
    "ground touches it in one point"
)
ON_CHART = "coordinates of a place on the ground, away from its edge and from where they end"
SYMMETRIC = Problem(
    "ground",
    "be symmetric about the plane of e1 and e3, at e2 = 0, in which a disk rolls, near its start and as it moves",
    "it is not; use a Ball",
)
SECTION_SAMPLES = np.linspace(-4.0, 4.0, 17)  # radii from the start of a disk at which its ground is looked at
SYMMETRY = 1e-6
Time = Float[Array, ""]
Coordinates = Float[Array, "*two"]  # those of a ball's contact point, or the one of a disk's along its section
Coordinate = Float[Array, ""]


class AbstractSurface(AbstractGround):
    """A smooth ground of any form, which may move and deform, for a ball, or for a disk where it is symmetric.

    An implementer supplies ``point(t, u1, u2)``, traced with ``jax.numpy``: where the piece of the ground with the
    coordinates u = (u1, u2) is at a time, as ∂p/∂u1 × ∂p/∂u2 points towards the ball. A piece keeps its coordinates:
    the velocity of the ground's matter is ∂p/∂t. And a field ``motion``, a :class:`~jaxball.physics.MovingFrame` that
    moves it as a rigid body, or None. Where the ground has an edge, or its coordinates do not reach all of it, also
    ``reach(t, u1, u2)``; a run ends there with the status ``LEFT_SURFACE``.

    With a law of contact the ball may fly, and the piece that is nearest to it is sought: ``nearest`` gives it in
    closed form, or else ``over`` says where to begin; by default, at the piece that was nearest before.

    The coordinates of the contact point are the ``z`` of a ball's state. A disk rolls along the ``section`` of the
    ground by the plane of e1 and e3, about which the ground must be symmetric, and its ``z`` is the coordinate along
    that. Methods take either as ``u``, coordinates of shape (2,) of a ball, and one number of a disk. Space axes are at
    rest, and gravity is −g e3. That the ground is touched in one point only is checked near that point alone: where it
    bends towards the ball as strongly as the ball is curved, a run ends with the status ``WEDGED``.
    """

    def __check_init__(self):
        require("motion", self.motion, (MovingFrame, type(None)), "a MovingFrame or None")

    @abc.abstractmethod
    def point(self, t: Time, u1: Coordinate, u2: Coordinate) -> Float[Array, "3"]:
        """Returns the place of the piece with these coordinates before ``motion`` moves it, length."""

    def reach(self, t: Time, u1: Coordinate, u2: Coordinate) -> Float[Array, ""]:
        """Computes how much of the ground is left ahead: 0 at its edge, or where its coordinates end, and positive
        inside.

        A number without a unit, of the order of 1 far from there; 1 everywhere if not supplied.
        """
        return jnp.ones_like(u1)

    def following(
        self,
        t: Time,
        theta: Float[Array, " driven"],
        thetadot: Float[Array, " driven"],
        thetaddot: Float[Array, " driven"],
    ) -> "AbstractSurface":
        """Returns the ground near the time ``t``, where its ``driven`` coordinates and their rates are these."""
        return self

    def at(self, t: Time, u1: Coordinate, u2: Coordinate) -> "AbstractSurface":
        """Returns the ground near the piece with these coordinates at that time, where its point and derivatives are
        taken.

        By default itself; where the piece has to be sought, the ground with that found.
        """
        return self

    def section(self, z: Coordinate) -> tuple[Coordinate, Coordinate]:
        """Returns the coordinates at ``z`` of the section along which a disk rolls: by default u1 = z and u2 = 0."""
        return z, jnp.zeros_like(z)

    def along_section(self, u: Float[Array, "2"]) -> Coordinate:
        """Returns the coordinate of a disk where both coordinates are ``u``: the inverse of ``section``, by default u1.

        A class with a ``section`` of its own needs its own inverse, too, for disks that may leave the ground.
        """
        if type(self).section is not AbstractSurface.section:
            raise NotImplementedError(
                f"A {type(self).__name__} must define `along_section`, the inverse of its `section`, for a disk with a "
                "law of contact, which finds its coordinate along the section from both of the nearest piece."
            )
        return u[0]

    def coordinates(self, u: Coordinates) -> Float[Array, "2"]:
        """Returns both coordinates of the contact point, of a ball or of a disk."""
        return u if u.ndim else jnp.stack(self.section(u))

    def conditions(self, planar: bool = False) -> Iterator[Condition]:
        if self.motion is not None:
            yield from self.motion.conditions("ground.motion")
        yield from AbstractGround.conditions(self, planar)

    def start_conditions(self, t: Time, r: Float[Array, ""], state: Any) -> Iterator[Condition | ExplainedCondition]:
        """Yields the conditions that a ball, of radius ``r``, is on the ground and more curved than it."""
        on_chart = self.way_to_edge(t, state.z) > margin(END_MARGIN, r)
        yield Condition(on_chart, "state.z", state.z, ON_CHART)
        fits = jnp.where(on_chart, self.fit(t, r, state.z), 1.0)

        def too_curved() -> Problem:
            radius = float(r / (1 - fits))
            but = f"the radius of its curvature is {radius:.6g} there, and that of the ball {float(r):.6g}"
            return Problem("ground", f"be {CURVED}", but)

        yield ExplainedCondition(fits > 0, too_curved)
        if not state.z.ndim:
            aside = self._aside(t, r, state.z)
            yield ExplainedCondition(~(aside > SYMMETRY), lambda: SYMMETRIC)

    @property
    def has_edge(self) -> bool:
        """Whether the ground, or its coordinates, may end somewhere."""
        return type(self).reach is not AbstractSurface.reach

    def way_to_edge(self, t: Time, u: Coordinates) -> Float[Array, ""]:
        """Computes how much of the ground is left ahead, as ``reach`` counts."""
        both = self.coordinates(u)
        return self.reach(t, both[0], both[1])

    def beyond_edge(self, t: Time, u: Coordinates) -> Float[Array, ""]:
        """Computes how far the coordinates ``u`` are beyond the edge, as ``reach`` counts; negative where there is
        ground.

        A body ends there in contact, but not in flight.
        """
        way = self.way_to_edge(t, u)
        return margin(LEAST_MARGIN, way) - way

    def _aside(self, t: Time, r: Float[Array, ""], z: Coordinate) -> Float[Array, ""]:
        """Computes how far the ground is from being symmetric about the plane of e1 and e3, near the ``z`` of a disk.

        These are components along e2, of places relative to ``r``, and of rates relative to whole vectors.
        """
        _, by_z, _ = self._slopes_along(t, z)
        scale = r / _length(by_z.p)

        def aside(share: Float[Array, ""]) -> Float[Array, ""]:
            contact, by_z, by_t = self._slopes_along(t, z + share * scale)
            rates = (by_z.p, by_z.n, contact.w, by_t.w)
            whole = [_length(v) + 1e-3 * (_length(by_z.p) if k < 2 else r) for k, v in enumerate(rates)]
            turned = [jnp.abs(v[1]) / size for v, size in zip(rates, whole, strict=True)]
            return jnp.max(jnp.stack([jnp.abs(contact.p[1]) / r, jnp.abs(contact.n[1]), *turned]))

        deviations = jax.vmap(aside)(jnp.asarray(SECTION_SAMPLES, z.dtype))
        return jnp.max(jnp.where(jnp.isnan(deviations), 0.0, deviations))

    def nearest(self, t: Time, x: Float[Array, "3"], near: Float[Array, "2"]) -> Float[Array, "2"]:
        """Finds the coordinates of the piece that is nearest to the point ``x``, before ``motion`` moves both, length.

        It is where ``x`` is on the normal. By default it is sought from ``over`` on, by Newton's method, so that it is
        the nearest piece thereabouts. Where a surface knows it in closed form, this is overridden; for one on which
        different coordinates belong to one place, ``near`` are those of a piece that was nearest before.
        """
        return nearest(self, t, x, self.over(t, x, near))

    def over(self, t: Time, x: Float[Array, "3"], near: Float[Array, "2"]) -> Float[Array, "2"]:
        """Returns the coordinates from which ``nearest`` is sought; by default ``near``."""
        return near

    @property
    def follows_foot(self) -> bool:
        """Whether ``nearest`` has to be sought from pieces that were the nearest before."""
        kind = type(self)
        return kind.nearest is AbstractSurface.nearest and kind.over is AbstractSurface.over

    def foot(self, t: Time, c: Float[Array, "3"], near: Coordinates) -> Coordinates:
        """Finds the coordinates of the piece that is nearest to the point ``c``, space axes, length.

        For the one ``near`` of a disk, of the piece along its section.
        """
        point, both = c if self.motion is None else self.motion.undo(t, c), self.coordinates(near)
        if near.ndim:
            return self.nearest(t, point, both)
        if type(self).nearest is not AbstractSurface.nearest:
            return self.along_section(self.nearest(t, point, both))
        start = self.along_section(self.over(t, point, both))
        return nearest(Section(self), t, point, jnp.stack([start, jnp.zeros_like(start)]))[0]

    def carry(self, t: Time, u: Float[Array, "2"], slopes: Slopes) -> Float[Array, "2"] | None:
        """Computes the rates of the coordinates of a piece of matter that is carried along the ground; None where
        nothing carries it.
        """
        return add(*(carrier.coordinate_rates(t, u, slopes) for carrier in self.carriers))

    def place(self, t: Time, u1: Coordinate, u2: Coordinate) -> Float[Array, "3"]:
        """Returns p, where the piece with these coordinates is in space."""
        point = self.point(t, u1, u2)
        return point if self.motion is None else self.motion.place(t, point)

    def normal(self, t: Time, u: Coordinates) -> Float[Array, "3"]:
        """Computes n at the coordinates ``u``, towards the ball, space axes."""
        return self.touch_at(t, u).n

    def place_of_centre(self, t: Time, r: Float[Array, ""], u: Coordinates) -> Float[Array, "3"]:
        """Computes c = p + r n of a ball of radius ``r`` that touches it at the coordinates ``u``, space axes."""
        contact = self.touch_at(t, u)
        return contact.p + r * contact.n

    def fit(self, t: Time, r: Float[Array, ""], u: Coordinates) -> Float[Array, ""]:
        """Computes the lesser of 1 − r κ over both principal curvatures κ, positive where the ground bends towards the
        ball.

        Positive where a ball of radius ``r`` fits the ground near the coordinates ``u``. For a disk, κ is the curvature
        of the section along which it rolls.
        """
        if not u.ndim:
            contact, by_z, _ = self._slopes_along(t, u)
            return _stretch(by_z, r)
        contact, (by_u1, by_u2, _) = self._slopes(t, u)
        return Chart.of(contact.n, by_u1, by_u2, r).fit

    def spare(self, t: Time, r: Float[Array, ""], u: Coordinates, least: Float[Array, ""]) -> Float[Array, ""]:
        """Computes what ``fit`` has above ``least``, as far as it is small, with all derivatives: λ₁ λ₂ / (λ₁ + λ₂)."""
        if not u.ndim:
            return self.fit(t, r, u) - least
        contact, (by_u1, by_u2, _) = self._slopes(t, u)
        S = Chart.of(contact.n, by_u1, by_u2, r).stretch - least * jnp.eye(2, dtype=r.dtype)
        return determinant(S) / (S[0, 0] + S[1, 1])

    def room(self, t: Time, r: Float[Array, ""], u: Coordinates) -> Float[Array, "2"]:
        """Computes how much ``fit`` and ``way_to_edge`` exceed what a ball of radius ``r`` needs to go on."""
        fit, way = jnp.stack([self.fit(t, r, u), self.way_to_edge(t, u)]) - margin(END_MARGIN, r)
        # Beyond the edge, curvatures of the ground mean nothing.
        return jnp.stack([jnp.where(way < 0, 1.0, fit), way])

    def end(self, t: Time, r: Float[Array, ""], u: Coordinates) -> Int[Array, ""]:
        """Returns why a ball of radius ``r`` cannot go on from the coordinates ``u``: a status, or SUCCESS."""
        wedged, left = self.room(t, r, u) < 0
        status = jnp.where(wedged, int(Status.WEDGED), int(Status.SUCCESS))
        return jnp.where(left, int(Status.LEFT_SURFACE), status)

    def footing(
        self,
        t: Time,
        r: Float[Array, ""],
        u: Coordinates,
        omega: Float[Array, "3"],
        V: Float[Array, "3"] | None = None,
        height: Float[Array, ""] | None = None,
    ) -> Footing:
        """Computes how the ground holds a ball of radius ``r`` that turns at ``omega``, space axes, where its
        coordinates are ``u``.

        ``V`` is the velocity of its centre, that of rolling if not given, and ``height`` how far it is above the ground
        there. Where the ball is not more curved than the ground, or rolls where the ground ends, u̇ is NaN, which ends a
        solve with a status.
        """
        if not u.ndim:
            return self._footing_along(t, r, u, omega, V, height)
        contact, (by_u1, by_u2, by_t) = self._slopes(t, u)
        # Above the ground the centre moves over a surface parallel to it, which bends as if the ball were larger.
        reach = add(r, height)
        chart = Chart.of(contact.n, by_u1, by_u2, reach)
        rolling = r * cross(omega, contact.n)
        over = rolling if V is None else V - contact.w
        # (∂c/∂u) u̇ = ċ − ∂c/∂t along the ground, with c = p + reach n and w = ∂p/∂t + what is carried along the ground.
        rates = chart.coordinates(add(over, contact.flow) - reach * by_t.n)
        # A body that slips or flies may be beyond the edge: ``footing_of_released`` knows whether it touches.
        if V is None:
            rates = jnp.where(self.way_to_edge(t, u) > margin(LEAST_MARGIN, r), rates, jnp.nan)
        # The gradient of w along both tangents, of which the antisymmetric part is the turning of the ground's matter.
        (a, b), tangents = chart.inverse.T, chart.tangents
        along_1, along_2 = by_u1.w * a[0] + by_u2.w * a[1], by_u1.w * b[0] + by_u2.w * b[1]
        about_normal = 0.5 * (dot(tangents[1], along_1) - dot(tangents[0], along_2))
        spin = dot(contact.n, along_2) * tangents[0] - dot(contact.n, along_1) * tangents[1] + about_normal * contact.n
        normal_rate, tangent_rate = (
            from_t + from_u1 * rates[0] + from_u2 * rates[1]
            for from_t, from_u1, from_u2 in ((by_t.n, by_u1.n, by_u2.n), (by_t.e, by_u1.e, by_u2.e))
        )
        return Footing(
            centre=contact.p + reach * contact.n,
            foot=contact.p,
            axes=jnp.concatenate([tangents, contact.n[None]]),
            velocity=contact.w,
            spin=spin,
            coordinate_rates=rates,
            normal_rate=normal_rate,
            acceleration=by_t.w + by_u1.w * rates[0] + by_u2.w * rates[1],
            turning=cross(contact.n, normal_rate) + dot(tangents[1], tangent_rate) * contact.n,
        )

    def _footing_along(
        self,
        t: Time,
        r: Float[Array, ""],
        z: Coordinate,
        omega: Float[Array, "3"],
        V: Float[Array, "3"] | None,
        height: Float[Array, ""] | None,
    ) -> Footing:
        """Computes how the ground holds a disk that turns at ``omega``, about e2, where its coordinate along the
        section is ``z``.
        """
        contact, by_z, by_t = self._slopes_along(t, z)
        reach = add(r, height)
        length, fit, tangents = _length(by_z.p), _stretch(by_z, reach), contact.axes[:2]
        rolling = r * cross(omega, contact.n)
        over = rolling if V is None else V - contact.w
        holds = fit > margin(LEAST_MARGIN, r)
        if V is None:
            holds &= self.way_to_edge(t, z) > margin(LEAST_MARGIN, r)
        rate = jnp.where(holds, dot(tangents[0], add(over, contact.flow) - reach * by_t.n) / (length * fit), jnp.nan)
        normal_rate = by_t.n + by_z.n * rate
        return Footing(
            centre=contact.p + reach * contact.n,
            foot=contact.p,
            axes=contact.axes,
            velocity=contact.w,
            spin=-dot(contact.n, by_z.w) / length * tangents[1],
            coordinate_rates=rate,
            normal_rate=normal_rate,
            acceleration=by_t.w + by_z.w * rate,
            turning=cross(contact.n, normal_rate),
        )

    # A function of programs, as are the two below: a body with a law of contact asks for it at many places. Written
    # at each of them, programs were three times as long, and a first run on a plate that tilts took two minutes.
    @eqx.filter_jit
    def touch_at(self, t: Time, u: Coordinates) -> Touch:
        """Computes place, normal and velocity of a piece, and the direction in which u1, or a disk's z, grows."""
        both = self.coordinates(u)
        here = self.at(t, both[0], both[1])
        contact = here.touch(t, both[0], both[1])
        if u.ndim:
            return contact
        _, along = _derivative(lambda x: here.place(t, *self.section(x)), u)
        return contact._replace(e=unit_vector(along))

    def touch(self, t: Time, u1: Coordinate, u2: Coordinate) -> Touch:
        """Computes the place of a piece, its normal, its velocity, the direction in which u1 grows, and the velocity at
        which it is carried along the ground; space axes.
        """
        p, along_1 = _derivative(lambda x: self.place(t, x, u2), u1)
        _, along_2 = _derivative(lambda x: self.place(t, u1, x), u2)
        _, w = _derivative(lambda x: self.place(x, u1, u2), t)
        carried = self.carry(t, jnp.stack([u1, u2]), (along_1, along_2))
        flow = None if carried is None else carried[0] * along_1 + carried[1] * along_2
        w = w if flow is None else w + flow
        return Touch(p, unit_vector(cross(along_1, along_2)), w, unit_vector(along_1), flow)

    @eqx.filter_jit
    def _slopes(self, t: Time, u: Float[Array, "2"]) -> tuple[Touch, tuple[Touch, Touch, Touch]]:
        """Computes p, n and w, and their derivatives by u1, u2 and t."""
        here = self.at(t, u[0], u[1])
        contact, by_u1 = _derivative(lambda x: here.touch(t, x, u[1]), u[0])
        _, by_u2 = _derivative(lambda x: here.touch(t, u[0], x), u[1])
        _, by_t = _derivative(lambda x: here.touch(x, u[0], u[1]), t)
        return contact, (by_u1, by_u2, by_t)

    @eqx.filter_jit
    def _slopes_along(self, t: Time, z: Coordinate) -> tuple[Touch, Touch, Touch]:
        """Computes p, n and w at the ``z`` of a disk, and their derivatives by z and t."""
        here = self.at(t, *self.section(z))
        contact, by_z = _derivative(lambda x: here.touch_at(t, x), z)
        _, by_t = _derivative(lambda x: here.touch_at(x, z), t)
        return contact, by_z, by_t


def _length(v: Float[Array, "3"]) -> Float[Array, ""]:
    return jnp.sqrt(jnp.sum(v**2))


def _stretch(by_z: Touch, r: Float[Array, ""]) -> Float[Array, ""]:
    """Computes 1 − r κ of the section: how far the centre of a disk moves for a step of its foot."""
    return 1 + r * dot(by_z.n, by_z.p) / jnp.sum(by_z.p**2)


def _derivative(function: Any, x: Float[Array, ""]) -> tuple[Any, Any]:
    """Computes the value and the derivative of a function of one number."""
    return jax.jvp(function, (x,), (jnp.ones_like(x),))
