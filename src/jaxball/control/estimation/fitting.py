"""Parameters and the initial state of a robot from a log of its sensors' readings, with their uncertainties.

The estimate has the greatest likelihood: the least sum of squares of residuals over their standard deviations, along
the exact motion. To first order its errors have the covariance of Cramér and Rao, the inverse of Σ HᵀR⁻¹H, where H are
the derivatives of the readings. Source: Bar-Shalom, Li & Kirubarajan, *Estimation with Applications to Tracking and
Navigation* (2001), chapters 2 and 3.
"""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ... import programs
from ...interface.arguments import refusal, require, require_callable
from ...interface.printing import Printed, repr_html
from ...interface.wording import number_of
from ...numerics.arrays import Numbers, default_dtype, to_array, to_numpy
from ...numerics.fitting import find_determined, fit_unknowns, where_finite
from ...physics.body import Ball, Disk, System
from ...physics.sensors import AbstractSensor
from ...physics.sensors.base import measurement_of
from ...physics.state import PlacedState
from ...physics.system import require_one_state
from ...simulation import DEFAULT_TOLERANCE
from ...simulation.simulate import simulate
from ..sampled import in_words
from ..weights import by_name
from .filter import require_not_negative

Robot = Callable[[dict[str, Array]], System]
UNDETERMINED_SHARE = 1e-3  # of a direction, by which an unknown may be part of an undetermined direction


@dataclasses.dataclass(frozen=True)
class Log:
    """What sensors have read.

    - ``times``: increasing, shape (T,).
    - ``readings``: of each sensor by name, as :meth:`jaxball.Trajectory.measured` has them, shape (T, ...): NaN where
      nothing has arrived.
    """

    times: Numbers
    readings: Mapping[str, Numbers]

    def fit(
        self,
        robot: Robot,
        parameters: Mapping[str, Numbers],
        start: PlacedState,
        sensors: Mapping[str, AbstractSensor],
        *,
        spread: Mapping[str, Numbers] | None = None,
        prior: Mapping[str, Numbers] | None = None,
        biases: Mapping[str, Numbers] | None = None,
        rtol: Numbers = DEFAULT_TOLERANCE,
        atol: Numbers = DEFAULT_TOLERANCE,
    ) -> "Fit":
        """Finds the parameters and the initial state of a robot that fit what its sensors have read best.

        Inputs are known, as signals and schedules of the robot.

        **Arguments:**

        - ``robot``: makes a :class:`~jaxball.Ball` or a :class:`~jaxball.Disk` from parameters, numbers by name;
          traced.
        - ``parameters``: first guesses of the parameters, by name.
        - ``start``: a guess of the state at the first time.
        - ``sensors``: by name, each with :class:`~jaxball.physics.sensors.SensorErrors` whose ``noise`` is positive and
          whose ``random_walk`` is 0; the value of ``bias`` is not used.
        - ``spread``: the standard deviations of the local coordinates of ``start`` that are not known, by name, as in
          ``{"Omega": 0.1, "z": np.inf}``; infinite where nothing is known. Others, or all where none are given, are
          taken for what they are in ``start``.
        - ``prior``: those of the first guesses of parameters; infinite if not given.
        - ``biases``: those of constant biases, by sensor; sensors that are not named have none.
        - ``rtol``, ``atol``: tolerances of the solve.

        **Raises:** ``ValueError`` and ``TypeError`` for readings, sensors and names that do not fit each other, and for
        guesses with which the robot cannot be simulated to the end of the log.

        **Example:**

        >>> import jax
        >>> import jax.numpy as jnp
        >>> jax.config.update("jax_enable_x64", True)
        >>> from jaxball import Disk, DiskState, simulate
        >>> from jaxball.control.estimation import Log
        >>> from jaxball.physics.sensors import Gyroscope, SensorErrors
        >>> sensors = {"gyro": Gyroscope(errors=SensorErrors(noise=0.1))}
        >>> times = jnp.linspace(0.0, 1.0, 100)
        >>> run = simulate(Disk(mass=1.0, inertia=0.5), times, DiskState(phidot=-1.0))
        >>> def robot(values):
        ...     return Disk(mass=values["mass"], inertia=0.5)
        >>> log = Log(times, run.measured(sensors))
        >>> found = log.fit(robot, {"mass": 1.2}, DiskState(), sensors, spread={"phidot": 1.0})
        >>> found.unidentifiable  # a disk rolls on whatever its mass is
        ('mass',)
        >>> round(found.deviations["phidot"], 4)  # 0.1/√100, and the guess
        0.01
        """
        problem = _problem(self, robot, parameters, start, sensors, spread or {}, prior or {}, biases or {}, rtol, atol)
        first = jnp.concatenate([problem.before, jnp.zeros(problem.prior.size - problem.before.size)])
        scale = np.asarray(_scales(problem))

        # In their own sizes, unknowns of any unit count alike in the steps and in what is negligible.
        def evaluate_by_scale(y: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray]:
            r, J, _ = _evaluate(problem, problem.guess, jnp.asarray(scale * np.asarray(y)))
            return np.asarray(r), np.asarray(J) * scale

        residuals, y0 = where_finite(evaluate_by_scale), np.asarray(first) / scale
        if not np.all(np.isfinite(residuals(tuple(y0))[0])):
            raise ValueError(
                "Argument `parameters` must make a robot that can be simulated from `start` to the end of the log, but "
                "it cannot; give other guesses."
            )
        y, converged = fit_unknowns(residuals, y0)
        return _fit(problem, jnp.asarray(scale * y), scale, converged)


@dataclasses.dataclass(frozen=True)
class Fit:
    """Parameters, the initial state and biases that fit a log.

    - ``names``: the unknowns: the parameters, local coordinates of the initial state, and biases.
    - ``parameters``, ``biases``: the estimates, by name.
    - ``state``: the estimated initial state.
    - ``covariance``: of the errors of the unknowns, those of the state in local coordinates around the estimate, shape
      (n, n); infinite on the diagonal, and 0 beside it, for what the log does not determine.
    - ``residuals``: reading less what is expected of it, over the standard deviation of its noise, for each sensor, as
      in the log; NaN where nothing was read.
    - ``chi2``, ``degrees``: the sum of their squares and of the prior's, and its degrees of freedom.
    - ``unidentifiable``: the combinations of unknowns that the log does not tell, in words.
    - ``ok``: whether the last step was negligible.
    """

    names: tuple[str, ...]
    parameters: dict[str, float]
    biases: dict[str, float]
    state: Any
    covariance: Float[np.ndarray, "n n"]
    residuals: dict[str, Float[np.ndarray, "T *components"]]
    chi2: float
    degrees: int
    unidentifiable: tuple[str, ...]
    ok: bool

    @property
    def deviations(self) -> dict[str, float]:
        """The standard deviation of the error of each unknown, by name."""
        return dict(zip(self.names, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))

    _repr_html_ = repr_html

    def __repr__(self) -> str:
        size, values = self.deviations, self.parameters | self.biases
        rows = [f"Fit of {len(self.names)} unknowns, χ² = {self.chi2:.4g} with {self.degrees} degrees of freedom"]
        rows += [f"  {name} = {value:.6g} ± {size[name]:.2g}" for name, value in values.items()]
        rows += [f"  {name} at the start: ± {size[name]:.2g}" for name in self.names if name not in values]
        rows += [f"  the log does not tell {combination}" for combination in self.unidentifiable]
        return "\n".join(rows if self.ok else [*rows, "  The search has not converged."])


class _Problem(Printed):
    """The residuals of a log as a function of unknowns: ``x`` are parameters, local coordinates and biases."""

    times: Float[Array, " T"]
    readings: dict[str, Float[Array, "T components"]]
    sensors: dict[str, AbstractSensor]
    guess: PlacedState
    prior: Float[Array, " n"]  # standard deviations, infinite where nothing was known
    before: Float[Array, " parameters"]
    rtol: Float[Array, ""]
    atol: Float[Array, ""]
    robot: Robot = eqx.field(static=True)
    parameters: tuple[str, ...] = eqx.field(static=True)
    places: tuple[int, ...] = eqx.field(static=True)  # of the unknown local coordinates
    biased: tuple[tuple[str, int], ...] = eqx.field(static=True)  # sensors with a bias, and their components

    def split(self, x: Float[Array, " n"]) -> tuple[dict[str, Array], Array, dict[str, Array]]:
        """Returns parameters by name, all local coordinates, and biases by sensor."""
        p, k = len(self.parameters), len(self.places)
        n = len(self.guess.directions)
        xi = jnp.zeros(n, x.dtype).at[np.asarray(self.places, int)].set(x[p : p + k])
        biases, first = {}, p + k
        for name, size in self.biased:
            biases[name] = x[first : first + size]
            first += size
        return {name: x[i] for i, name in enumerate(self.parameters)}, xi, biases

    def residuals(self, base: PlacedState, x: Float[Array, " n"]) -> tuple[dict[str, Array], Array]:
        """Computes the residuals of each reading over its noise, 0 where there is none; and of the prior, over its
        spread.
        """
        values, xi, biases = self.split(x)
        start = base.retract(xi)
        # Forward mode: there are few unknowns and many residuals.
        settings: dict[str, Any] = {"rtol": self.rtol, "atol": self.atol, "adjoint": diffrax.ForwardMode()}
        run = simulate(self.robot(values), self.times, start, **settings)
        # The errors of sensors are what residuals consist of, so that readings are compared with exact ones.
        exact = run.measured(
            {name: dataclasses.replace(instrument, errors=None) for name, instrument in self.sensors.items()}
        )
        misfits = {}
        for name, sensor in self.sensors.items():
            assert sensor.errors is not None
            # Readings arrive later; they are compared with the values at the times at which they were taken.
            place, _ = sensor.errors.arrivals(self.times)
            expected = exact[name].reshape(len(self.times), -1)[place] + biases.get(name, jnp.zeros(1))[None]
            read = self.readings[name]
            there = jnp.isfinite(read)
            # The inner `where` keeps NaN, of missing readings, out of the derivatives.
            misfits[name] = jnp.where(there, (jnp.where(there, read, 0.0) - expected) / sensor.errors.noise, 0.0)
        prior_misfit = jnp.concatenate(
            # The prior is about the guess, and not about the state around which x is counted.
            [self.before - x[: self.before.size], self.guess.difference(start)[np.asarray(self.places, int)]]
        )
        rest = jnp.concatenate([prior_misfit, x[prior_misfit.size :]])
        # An infinite spread makes the residual of an unknown prior 0.
        return misfits, rest / self.prior


def _problem(
    log: Log,
    robot: Robot,
    parameters: Mapping[str, Numbers],
    start: PlacedState,
    sensors: Mapping[str, AbstractSensor],
    spread: Mapping[str, Numbers],
    prior: Mapping[str, Numbers],
    biases: Mapping[str, Numbers],
    rtol: Numbers,
    atol: Numbers,
) -> _Problem:
    require("parameters", parameters, Mapping, 'a dictionary of first guesses by name, such as {"mass": 1.0}')
    require_callable("robot", robot, "parameters")
    before = {name: to_array(value, f"parameters[{name!r}]") for name, value in parameters.items()}
    system = robot(before)
    require("robot(parameters)", system, (Ball, Disk), "a Ball or a Disk")
    require_one_state(system, start)
    directions = start.directions
    deviations = by_name("spread", spread, directions)
    of_parameters = by_name("prior", prior, tuple(parameters), other=np.inf)
    for name, values in (("spread", deviations), ("prior", of_parameters)):
        require_not_negative(name, jnp.asarray(values))
    places = tuple(np.flatnonzero(deviations).tolist())
    measurement = measurement_of(sensors, system)
    ordered = measurement.sensors
    times, readings = _read(log, ordered, measurement.sizes(system, start))
    sizes = {name: readings[name].shape[1] for name in ordered if name in biases}
    for name in biases:
        if name not in ordered:
            raise ValueError(
                f"Argument `biases` must name sensors, which are {', '.join(ordered)}, but names {name!r}."
            )
    of_biases = [np.full(size, float(to_numpy(biases[name], "biases"))) for name, size in sizes.items()]
    whole = np.concatenate([of_parameters, deviations[list(places)], *of_biases])
    if not whole.size:
        raise ValueError("Arguments `parameters`, `spread` and `biases` must name one unknown or more, but name none.")
    guesses = jnp.asarray([float(value) for value in before.values()], default_dtype())
    return _Problem(
        times,
        readings,
        dict(ordered),
        start,
        jnp.asarray(whole, default_dtype()),
        guesses,
        to_array(rtol, "rtol"),
        to_array(atol, "atol"),
        robot,
        tuple(before),
        places,
        tuple(sizes.items()),
    )


def _read(
    log: Log, sensors: Mapping[str, AbstractSensor], components: Mapping[str, int]
) -> tuple[Float[Array, " T"], dict[str, Float[Array, "T components"]]]:
    """Reads the times, and the readings of each sensor in rows of as many ``components`` as it has.

    **Raises:** ``ValueError`` for times and readings that do not fit each other or the errors of a sensor.
    """
    times = to_numpy(log.times, "log.times")
    if times.ndim != 1 or times.size < 2:
        raise ValueError(f"Argument `log.times` must be two increasing times or more, but its shape is {times.shape}.")
    if (back := np.flatnonzero(~(np.diff(times) > 0))).size:
        k = int(back[0])
        raise ValueError(
            f"Argument `log.times` must be increasing, but times[{k}] is {times[k]:g}, and times[{k + 1}] is "
            f"{times[k + 1]:g}."
        )
    readings = {}
    for name, sensor in sensors.items():
        if name not in log.readings:
            raise ValueError(f"Argument `log.readings` must have those of every sensor, but {name!r} is missing.")
        rows = np.asarray(log.readings[name], dtype=float)
        if rows.ndim == 0 or len(rows) != times.size:
            raise refusal(f"log.readings[{name!r}]", f"readings at each of the {times.size} times", log.readings[name])
        rows = rows.reshape(times.size, -1)
        if rows.shape[1] != components[name]:
            raise ValueError(
                f"Argument `log.readings[{name!r}]` must have {number_of(components[name], 'component')} at each time, "
                f"as the sensor has, but it has {rows.shape[1]}."
            )
        assert sensor.errors is not None
        sensor.errors.require_times(f"sensors[{name!r}].errors", times)
        if np.asarray(sensor.errors.random_walk) > 0:
            raise ValueError(
                f"Argument `sensors[{name!r}].errors.random_walk` must be 0, because a fit takes the errors of "
                "readings for independent; an ErrorStateFilter estimates a bias that wanders."
            )
        readings[name] = jnp.asarray(rows, default_dtype())
    return jnp.asarray(times, default_dtype()), readings


def _scales(problem: _Problem) -> Float[Array, " n"]:
    """Returns the sizes of unknowns: the size of a guess, or of its prior, or 1."""
    guessed = jnp.concatenate([jnp.abs(problem.before), jnp.zeros(problem.prior.size - problem.before.size)])
    prior_scale = jnp.where(jnp.isfinite(problem.prior), problem.prior, 1.0)
    return jnp.where(guessed > 0, guessed, prior_scale)


@programs.filter_jit
def _evaluate(
    problem: _Problem, base: PlacedState, x: Float[Array, " n"]
) -> tuple[Float[Array, " residuals"], Float[Array, "residuals n"], dict[str, Array]]:
    """Evaluates the residuals, their Jacobian by x, and those of each sensor."""

    def residuals(x: Array) -> tuple[Array, dict[str, Array]]:
        misfits, prior_misfit = problem.residuals(base, x)
        return jnp.concatenate([*map(jnp.ravel, misfits.values()), prior_misfit]), misfits

    # One direction after the other: side by side, the program would take several times as long to compile.
    def along(v: Array) -> tuple[Array, Array, dict[str, Array]]:
        return jax.jvp(residuals, (x,), (v,), has_aux=True)

    r, columns, misfits = jax.lax.map(along, jnp.eye(x.size, dtype=x.dtype))
    return r[0], columns.T, {name: rows[0] for name, rows in misfits.items()}


def _fit(problem: _Problem, x: Float[Array, " n"], scale: Float[np.ndarray, " n"], converged: bool) -> Fit:
    """Returns the estimates at the unknowns ``x``, with local coordinates around the estimated state."""
    values, xi, _ = problem.split(x)
    state, p, k = problem.guess.retract(xi), len(problem.parameters), len(problem.places)
    # At the estimate the local coordinates are 0, so that the covariance is that of errors around it.
    r, J, misfits = _evaluate(problem, state, x.at[p : p + k].set(0.0))
    r, J = np.asarray(r), np.asarray(J) * scale
    _, s, Vt = np.linalg.svd(J, full_matrices=False)
    # In scales, so that whether a direction is determined does not depend on units.
    seen = find_determined(s)
    covariance = (Vt[seen].T / s[seen] ** 2) @ Vt[seen] * np.outer(scale, scale)
    lost = np.any(np.abs(Vt[~seen]) > UNDETERMINED_SHARE, axis=0)
    # No finite covariance belongs to what the log does not determine.
    covariance = np.where(np.logical_or.outer(lost, lost), 0.0, covariance)
    covariance[lost, lost] = np.inf
    names = _names(problem)
    read = {name: np.isfinite(np.asarray(rows)) for name, rows in problem.readings.items()}
    whitened = {name: np.where(read[name], np.asarray(misfits[name]), np.nan) for name in read}
    # Priors are readings as well, each of one number.
    count = sum(int(np.sum(there)) for there in read.values()) + int(np.sum(np.isfinite(problem.prior)))
    return Fit(
        names=names,
        parameters={name: float(value) for name, value in values.items()},
        biases=dict(zip(names[p + k :], np.asarray(x)[p + k :].tolist(), strict=True)),
        state=state,
        covariance=covariance,
        residuals={name: rows[:, 0] if rows.shape[1] == 1 else rows for name, rows in whitened.items()},
        chi2=float(r @ r),
        degrees=count - int(np.sum(seen)),
        unidentifiable=in_words(Vt[~seen] * scale, names),
        ok=converged,
    )


def _names(problem: _Problem) -> tuple[str, ...]:
    """Returns the names of parameters, local coordinates and biases."""
    directions = problem.guess.directions
    biases = [f"{name}[{i}]" if size > 1 else name for name, size in problem.biased for i in range(size)]
    return (*problem.parameters, *(directions[place] for place in problem.places), *biases)
