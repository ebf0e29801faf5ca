"""The contract of benchmark problems: equations written once in scalars, and a known final state."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Array, Float

from jaxball.numerics.arrays import Numbers

Scalar = Any  # a float, a JAX scalar, a CasADi SX, a heyoka expression, a SymPy symbol


@runtime_checkable
class Functions(Protocol):
    """The functions that equations may call besides + − × ÷: ``math``, ``jax.numpy``, ``casadi``, ``heyoka``…"""

    @property
    def sin(self) -> Callable[[Scalar], Scalar]: ...
    @property
    def cos(self) -> Callable[[Scalar], Scalar]: ...


Rates = Callable[[Scalar, Sequence[Scalar], Sequence[Scalar], Functions], list[Scalar]]
Constraint = Callable[[Sequence[Scalar]], Scalar]


@dataclass(frozen=True)
class Piece:
    """An interval on which the equations are smooth; every solver is stopped at its end and restarted.

    - ``parameters``: the values p of the parameters, constant on the piece.
    - ``algebraic``: of a DAE, the index of the component whose rate the constraint replaces.
    """

    start: float
    end: float
    parameters: tuple[float, ...] = ()
    algebraic: int | None = None


@dataclass(frozen=True)
class Form:
    """The same problem as jaxball itself formulates it, in JAX and with another state.

    - ``field``: f(t, x, args), valid on the whole interval; at a kink it has either one-sided value.
    - ``initial``: x at the problem's start.
    - ``final``: from x at the problem's end to the state of the problem.
    - ``mass``, ``choose``: of a DAE, the diagonal of M for an algebraic component, and the algebraic component in a
      step that starts at x; the ``args`` of ``field`` are that component.
    """

    field: Callable[[Float[Array, ""], Float[Array, " form"], Any], Float[Array, " form"]]
    initial: tuple[float, ...]
    final: Callable[[Float[np.ndarray, " form"]], Float[np.ndarray, " state"]]
    mass: Callable[[Any], Float[Array, " form"]] | None = None
    choose: Callable[[Float[Array, ""], Float[Array, " form"], Any], Any] | None = None


@dataclass(frozen=True)
class Problem:
    """An initial value problem ẋ = f(t, x, p), or a semi-explicit DAE, with its solution at the end.

    - ``name``, ``title``: for files and for figures.
    - ``source``: where equations and final state come from.
    - ``pieces``: the interval, cut where the equations are not smooth or where a DAE changes its algebraic component.
    - ``initial``: x at the start.
    - ``rates``: f, called as ``rates(t, x, p, functions)``, without branches.
    - ``exact``: x at the end.
    - ``measured``: the components whose error counts.
    - ``relative``: whether an error is divided by the exact value.
    - ``stiff``: whether explicit methods are left out.
    - ``atol_over_rtol``: the ratio of the absolute to the relative tolerance for every solver.
    - ``constraint``: of a DAE, h in h(x) = 0.
    - ``form``: makes the problem as jaxball itself would formulate it, if that differs; it calls JAX, so it is called
      only when needed.
    """

    name: str
    title: str
    source: str
    pieces: tuple[Piece, ...]
    initial: tuple[float, ...]
    rates: Rates
    exact: tuple[float, ...]
    measured: tuple[int, ...]
    relative: bool
    stiff: bool
    atol_over_rtol: float
    constraint: Constraint | None = None
    form: Callable[[], Form] | None = None

    @property
    def start(self) -> float:
        return self.pieces[0].start

    @property
    def end(self) -> float:
        return self.pieces[-1].end

    @property
    def kinks(self) -> tuple[float, ...]:
        """The times between pieces."""
        return tuple(piece.start for piece in self.pieces[1:])

    def right_hand_side(self, piece: Piece) -> Rates:
        """g in M ẋ = g(t, x, p) on ``piece``: the rates, with the constraint at the algebraic component of a DAE."""
        constraint, k = self.constraint, piece.algebraic
        if constraint is None or k is None:
            return self.rates

        def g(t: Scalar, x: Sequence[Scalar], p: Sequence[Scalar], functions: Functions) -> list[Scalar]:
            rates = self.rates(t, x, p, functions)
            return [*rates[:k], constraint(x), *rates[k + 1 :]]

        return g

    def mass(self, piece: Piece) -> tuple[float, ...] | None:
        """The diagonal of M in M ẋ = g on ``piece``: ones, and a zero for the algebraic equation; None for an ODE."""
        if piece.algebraic is None:
            return None
        return tuple(float(i != piece.algebraic) for i in range(len(self.initial)))

    def error(self, x: Numbers) -> float:
        """The largest error of the measured components of ``x``, the state at the end; infinite if not finite.

        **Raises:** ``ValueError`` when the length of ``x`` differs from that of the state.
        """
        given, exact = np.asarray(x, dtype=float), np.asarray(self.exact)
        if given.shape != exact.shape:
            raise ValueError(
                f"Argument `x` must be the state of problem {self.name} at its end, of shape {exact.shape}, "
                f"but its shape is {given.shape}; a state of `form` goes through `form.final` first."
            )
        indices = list(self.measured)
        given, exact = given[indices], exact[indices]
        if not np.isfinite(given).all():
            return float("inf")
        difference = np.abs(given - exact)
        return float(np.max(difference / np.abs(exact) if self.relative else difference))
