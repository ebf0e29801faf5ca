"""Your own system: the Chaplygin sleigh, a rigid body on a plane with a blade that cannot slip sideways."""

from typing import ClassVar, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float
from matplotlib.figure import Figure

from jaxball import AbstractSystem, Event, simulate
from jaxball.analysis.chaos import lyapunov_spectrum
from jaxball.physics import AbstractState

jax.config.update("jax_enable_x64", True)


class SleighState(AbstractState):
    """Heading, speed v along the blade, angular velocity w, and the position of the blade."""

    heading: Float[Array, ""] = eqx.field(converter=jnp.asarray, default=0.0)
    v: Float[Array, ""] = eqx.field(converter=jnp.asarray, default=0.0)
    w: Float[Array, ""] = eqx.field(converter=jnp.asarray, default=1.0)
    place: Float[Array, "2"] = eqx.field(converter=jnp.asarray, default=(0.0, 0.0))


class SleighLaws(NamedTuple):
    energy: Float[Array, ""]


class Sleigh(AbstractSystem[SleighState]):
    """Mass 1, centre of mass at a distance a ahead of the blade, and radius of gyration k about the blade."""

    a: Float[Array, ""] = eqx.field(converter=jnp.asarray)
    k: Float[Array, ""] = eqx.field(converter=jnp.asarray)

    title: ClassVar[str] = "Chaplygin sleigh"
    state_type: ClassVar[type[SleighState]] = SleighState

    def field(self, t, state):
        v, w, along = state.v, state.w, jnp.stack([jnp.cos(state.heading), jnp.sin(state.heading)])
        return SleighState(heading=w, v=self.a * w**2, w=-self.a * v * w / self.k**2, place=v * along)

    def laws(self, t, state):
        return SleighLaws(0.5 * (state.v**2 + self.k**2 * state.w**2))


sleigh, times = Sleigh(0.5, 0.8), jnp.linspace(0.0, 20.0, 101)
run = simulate(sleigh, times, events={"across": Event(lambda system, t, state: state.place[1] - 1.0)}, throw=True)
exact = 0.8 * jnp.tanh(0.5 * times / 0.8)  # v of the sleigh that starts with v = 0, w = 1
print(f"error of v {jnp.max(jnp.abs(run.state.v - exact)):.1e}, of the energy {jnp.ptp(run.laws.energy):.1e}")
print(f"the blade crosses y = 1 at t = {run.events['across'].times[0]:.6f}")


def end(a):
    return simulate(Sleigh(a, 0.8), times, adjoint=diffrax.ForwardMode()).state.place[-1]


print(f"derivative of its final position with respect to a: {jax.jacfwd(end)(jnp.asarray(0.5))}")
# The sleigh ends on a straight line with v = 0.8, where one exponent is −a v / k² = −0.625, and the others are 0.
print(f"Lyapunov exponents {jnp.round(lyapunov_spectrum(sleigh, (0.0, 200.0), transient=100.0).exponents, 4)}")

figure = Figure(figsize=(5.0, 2.6), layout="constrained")
ax = figure.subplots()
ax.plot(*run.state.place.T)
ax.plot(*run.events["across"].state.place[0], "o", label="$y = 1$")
ax.set(xlabel="$x$", ylabel="$y$", aspect="equal")
ax.legend(frameon=False)
figure.savefig("sleigh.png", dpi=150)
print("written: sleigh.png")
