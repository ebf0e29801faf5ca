"""How far rails come from the centre of the body, and how far out of a disk's plane: bounds for many at once."""

import functools
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from ...physics.frames import AbstractFrame, MatrixFrame
from ...physics.rails import (
    AbstractPlanarRail,
    AbstractRail,
    BernoulliEight,
    Circle,
    Ellipse,
    FourierRail,
    GeronoEight,
)
from .compiled import on_rows

Stacked = Float[np.ndarray, "_ _"]  # rows and masses, or 1 in the place of either
COARSE = 2  # one in so many of the check's samples


class Bounds(NamedTuple):
    """No point of a rail is further than ``far`` from the centre, or than ``aside`` from the plane of E1 and E3."""

    far: Stacked
    aside: Stacked


@functools.singledispatch
def bounds(rail: AbstractRail, frames: Any = None) -> Bounds | None:
    """Bounds on rails stacked along two axes; None for a kind of which none are known."""
    return None


@bounds.register
def _(rail: AbstractPlanarRail, frames: Any = None) -> Bounds | None:
    B = matrices(rail.frame) if frames is None else frames
    along, rho = np.einsum("...ij,...i->...j", B, rail.centre), extent(rail)
    if rho is None:
        return None
    off = np.hypot(along[..., 0], along[..., 2])
    far = np.hypot(along[..., 1], off + rho)
    aside = np.abs(rail.centre[..., 1]) + rho * np.hypot(B[..., 1, 0], B[..., 1, 2])
    return Bounds(far, aside)


@bounds.register
def _(rail: FourierRail, frames: Any = None) -> Bounds:
    size = np.hypot(rail.cosine, rail.sine)  # of each harmonic of each coordinate
    far = _norm(np.asarray(rail.centre)) + np.sum(_norm(size), axis=-1)
    aside = np.abs(rail.centre[..., 1]) + np.sum(size[..., 1], axis=-1)
    return Bounds(far, aside)


@functools.singledispatch
def extent(rail: AbstractPlanarRail) -> np.ndarray | None:
    """The largest distance of a planar curve from the origin of its own plane; None for an unknown one."""
    return None


@extent.register
def _(rail: Circle) -> np.ndarray:
    return np.asarray(rail.radius)


@extent.register
def _(rail: Ellipse) -> np.ndarray:
    return np.max(rail.semi_axes, axis=-1)


@extent.register
def _(rail: GeronoEight) -> np.ndarray:
    """The largest a² u + 4 b² u (1 − u) with u = cos² θ."""
    a, b = np.square(rail.half_extents[..., 0]), np.square(rail.half_extents[..., 1])
    u = np.minimum(1.0, (a + 4 * b) / (8 * b))
    return np.sqrt(a * u + 4 * b * u * (1 - u)) * (1 + 1e-12)


@extent.register
def _(rail: BernoulliEight) -> np.ndarray:
    return np.asarray(rail.half_width)


def matrices(frame: AbstractFrame) -> Float[np.ndarray, "_ _ 3 3"]:
    """The matrices of stacked frames."""
    return np.asarray(frame.B) if isinstance(frame, MatrixFrame) else on_rows(_matrices, frame)


def farthest_sample(rail: AbstractRail) -> Stacked:
    """The largest distance from the centre among some of the samples that the check takes of a closed rail."""
    period = rail.period
    assert period is not None
    theta = np.linspace(0.0, period, rail.samples, endpoint=False)[::COARSE]
    return np.max(_norm(on_rows(functools.partial(_points, theta), rail)), axis=-1)


def distance(rail: AbstractRail, theta: Float[np.ndarray, " rows"]) -> Float[np.ndarray, " rows"]:
    """|ζ(θ)| of rails stacked along one axis."""
    return _norm(on_rows(lambda given: _point(*given), (rail, theta)))


@jax.jit
def _matrices(frame):
    return jax.vmap(jax.vmap(lambda one: one.matrix()))(frame)


@jax.jit
def _points(theta, rail):
    return jax.vmap(jax.vmap(lambda one: one.points(theta)))(rail)


@jax.jit
def _point(rail, theta):
    return jax.vmap(lambda one, angle: one.prepare()(angle))(rail, theta)


def _norm(x: np.ndarray) -> np.ndarray:
    return np.sqrt(np.sum(np.square(x), axis=-1))
