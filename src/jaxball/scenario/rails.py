"""The rails that a scenario file can hold, and their keys."""

from typing import Any

from ..interface.arguments import require_function
from ..interface.wording import counted
from ..numerics.arrays import a_number
from ..physics.rails import AbstractRail, BernoulliEight, Circle, Ellipse, FourierRail, GeronoEight, SplineRail, Tube
from .frames import FRAME
from .own import Open
from .table import Family, Key, Module, join
from .values import LENGTH, NOT_ALL_ZERO, POSITIVE, Numbers, key_error

SIZE = Numbers(rule=POSITIVE, dimension=LENGTH)
SIZES = Numbers((2,), POSITIVE, LENGTH)
ROWS = Numbers((None, 3), dimension=LENGTH)
CENTRE = Key(Numbers((3,), dimension=LENGTH), (0.0, 0.0, 0.0))
PLACE = {"centre": CENTRE, "frame": FRAME}


def _check_harmonics(table: dict[str, Any], path: str) -> None:
    n, m = len(table["cosine"]), len(table["sine"])
    if m != n:
        raise key_error(join(path, "sine"), f"as long as `cosine`, which has {counted(n, 'row')}", f"one of {m}")


def _check_points(table: dict[str, Any], path: str) -> None:
    n = len(table["points"])
    if n < 3:
        raise key_error(join(path, "points"), "a list of three points or more", f"one of {n}")


def _spline(points) -> SplineRail:
    return SplineRail(points)


def _check_rail(rail: AbstractRail) -> None:
    require_function("rail", rail.__call__, (3,), theta=a_number())


_FAMILIES: Family = {
    "circle": Module(Circle, {"radius": Key(SIZE), **PLACE}),
    "ellipse": Module(Ellipse, {"semi_axes": Key(SIZES), **PLACE}),
    "gerono-eight": Module(GeronoEight, {"half_extents": Key(SIZES), **PLACE}),
    "bernoulli-eight": Module(BernoulliEight, {"half_width": Key(SIZE), **PLACE}),
    "tube": Module(Tube, {"direction": Key(Numbers((3,), NOT_ALL_ZERO)), "centre": CENTRE}),
    "fourier": Module(FourierRail, {"cosine": Key(ROWS), "sine": Key(ROWS), "centre": CENTRE}, check=_check_harmonics),
    "spline": Module(
        SplineRail,
        {"points": Key(ROWS)},
        build=_spline,
        attributes={"points": "points_on_rail"},
        check=_check_points,
    ),
}
RAILS = Open(AbstractRail, _FAMILIES, _check_rail)
