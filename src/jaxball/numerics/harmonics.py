"""A constant plus sinusoids, and powers of the time: the form shared by forces, schedules and free motions."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..interface.printing import Printed
from .arrays import Numbers, to_array
from .trigonometry import sine_cosine


class HarmonicSeries(Printed):
    """f(t) = constant + Σ powers_j t^(j + 1) + Σ amplitude_k sin(frequency_k t + phase_k).

    **Arguments:**

    - ``constant``: of any shape and unit.
    - ``amplitude``: in the same unit, one entry for each sinusoid, shape (terms, ...).
    - ``frequency``: rad/time, shape (terms,).
    - ``phase``: rad, shape (terms,); zero if not given.
    - ``powers``: the coefficients of t, t², …, in the unit of ``constant`` over powers of time, shape (degree, ...);
      none, at no cost, if not given.

    **Raises:** ``ValueError`` when the shapes do not fit each other.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import HarmonicSeries
    >>> series = HarmonicSeries((0.0, 0.0, 0.3), amplitude=[(0.2, 0.0, 0.0)], frequency=[2.0], phase=[jnp.pi / 2])
    >>> series(jnp.array(0.0))
    Array([0.2, 0. , 0.3], dtype=float64)
    >>> fall = HarmonicSeries(1.0, powers=[0.0, -0.5])  # 1 − t²/2
    >>> float(fall(jnp.array(2.0)))
    -1.0
    """

    constant: Float[Array, "..."]
    amplitude: Float[Array, "..."]
    frequency: Float[Array, "*group terms"]
    phase: Float[Array, "*group terms"]
    powers: Float[Array, "..."] | None

    def __init__(
        self,
        constant: Numbers,
        amplitude: Numbers | None = None,
        frequency: Numbers = (),
        phase: Numbers | None = None,
        powers: Numbers | None = None,
    ):
        self.constant = to_array(constant, "constant")
        self.frequency = to_array(frequency, "frequency")
        terms = self.frequency.shape[0] if self.frequency.ndim == 1 else None
        shape = (terms, *self.constant.shape)
        self.amplitude = (
            jnp.zeros_like(self.constant, shape=(0, *shape[1:]))
            if amplitude is None
            else to_array(amplitude, "amplitude")
        )
        self.phase = jnp.zeros_like(self.frequency) if phase is None else to_array(phase, "phase")
        if self.amplitude.shape != shape or self.phase.shape != self.frequency.shape:
            raise ValueError(
                "Arguments `amplitude`, `frequency` and `phase` must have one entry for each "
                f"sinusoid, but their shapes are {self.amplitude.shape}, {self.frequency.shape} and "
                f"{self.phase.shape}, beside a constant of shape {self.constant.shape}."
            )
        self.powers = None if powers is None else to_array(powers, "powers")
        if self.powers is not None and (self.powers.ndim == 0 or self.powers.shape[1:] != shape[1:]):
            raise ValueError(
                "Argument `powers` must have one entry for each power of the time, each of the shape "
                f"{self.constant.shape} of the constant, but its shape is {self.powers.shape}."
            )

    def __call__(self, t: Float[Array, ""]) -> Float[Array, "*shape"]:
        waves, _ = sine_cosine(self.frequency * t + self.phase)
        waves = waves.reshape(waves.shape + (1,) * self.constant.ndim)
        value = self.constant + jnp.sum(self.amplitude * waves, axis=0)
        if self.powers is None:
            return value
        polynomial = jnp.zeros_like(self.constant)
        for row in self.powers[::-1]:  # by Horner's rule
            polynomial = (polynomial + row) * t
        return value + polynomial
