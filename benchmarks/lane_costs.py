"""What runs and their parts cost in lanes: an ensemble, steps without control, and steps that evaluate less."""

import jax
import jax.numpy as jnp
import numpy as np
import perturbed
from jax.flatten_util import ravel_pytree
from jaxball_batch import TIMES, at

from jaxball import BallState
from jaxball.ensemble import simulate_ensemble
from jaxball.ensemble.runge_kutta import step
from jaxball.numerics.lanes import LaneProgram
from jaxball.physics.moments import velocity_moments
from jaxball.physics.packing import Packing
from jaxball.simulation.arguments import DEFAULT_SOLVER

LANES = 64  # as simulate_ensemble
STEPS, LENGTH = 1000, 0.01
EVALUATIONS = DEFAULT_SOLVER.tableau.num_stages - 1  # of a step


class Runs:
    """All rows by ``simulate_ensemble`` on one core."""

    def __init__(self, ball, rows: int, tolerance: float):
        self.given = ball, TIMES, at(*perturbed.initial(rows))
        self.tolerance = tolerance
        ensemble = self()
        self.steps = int(np.sum(np.asarray(ensemble.trajectory.steps)))
        self.evaluations = int(ensemble.executed) * EVALUATIONS

    def __call__(self):
        return simulate_ensemble(*self.given, rtol=self.tolerance, atol=self.tolerance, threads=1, in_axes=(None, 0))


class Stages:
    """A compiled loop of steps of equal length in ``LANES`` lanes, with neither control nor refilling."""

    count = LANES * STEPS * EVALUATIONS

    def __init__(self, program: LaneProgram, ball):
        tableau, x = DEFAULT_SOLVER.tableau, _start()

        @jax.jit
        def loop(parameters, x):
            prepared = program.prepare(parameters)

            def field(t, x):
                return program(prepared, [t, *x])

            def again(_, carry):
                t, x, first = carry
                taken = step(tableau, field, t, t + LENGTH, x, first, jnp.zeros(LANES, bool))
                return taken.end, taken.y + 1e-9 * taken.error, taken.last

            return jax.lax.fori_loop(0, STEPS, again, (jnp.zeros(LANES), x, x))

        parameters = [jnp.asarray(number) for leaf in jax.tree.leaves(ball) for number in np.asarray(leaf).reshape(-1)]
        self.call = lambda: jax.block_until_ready(loop(parameters, x))

    def __call__(self):
        return self.call()


def right_hand_side(ball) -> LaneProgram:
    """What a solver evaluates at each stage."""
    state = BallState()

    def field(system, t, x):
        return Packing.of(system.prepare(), state).field(t, x)

    return _program(field, ball)


def moments_alone(ball) -> LaneProgram:
    """A slope that sums the moments and their rates, so that it costs them and little else."""
    nothing = jnp.zeros(0)

    def field(system, t, x):
        found = ravel_pytree(velocity_moments(system.prepare(), t, (nothing, nothing)))[0]
        return jnp.sum(jnp.pad(found, (0, -found.size % x.size)).reshape(-1, x.size), axis=0)

    return _program(field, ball)


def nothing_at_all(ball) -> LaneProgram:
    """A slope that costs nothing: what is left are the sums of the stages."""
    return _program(lambda system, t, x: -x, ball)


def _program(field, ball) -> LaneProgram:
    return LaneProgram(field, jax.tree.map(np.asarray, ball), np.zeros(()), np.zeros(_start().shape[0]))


def _start():
    q, Omega = perturbed.initial(LANES)
    return jnp.asarray(np.concatenate([q, Omega, np.zeros((LANES, 2))], axis=1).T)
