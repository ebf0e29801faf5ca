"""The least time that a device needs for a step of a solve: by its arithmetic, and by its memory.

Operations are counted in the program of the right-hand side, element by element, and in the sums of the tableau.
"""

import collections
from typing import NamedTuple

import harness
import jax
import jax.numpy as jnp
import numpy as np
from lane_costs import EVALUATIONS, right_hand_side

from jaxball import paper
from jaxball.simulation.arguments import DEFAULT_SOLVER

# What counts as more than one operation: about what a division takes on a GPU.
WEIGHTS = {"div": 8, "sqrt": 8, "rsqrt": 8, "sin": 20, "cos": 20}
MOVES = ("broadcast_in_dim", "reshape", "concatenate", "slice", "squeeze", "stack", "copy", "convert_element_type")
# Float64 operations and bytes a second, by the makers' data sheets, without matrix units.
PEAKS = {
    "H200": (34e12, 4.8e12),
    "H100 PCIe": (26e12, 2.0e12),
    "H100": (34e12, 3.35e12),
    "A100": (9.7e12, 2.0e12),
    "V100": (7.8e12, 0.9e12),
    "L4": (0.47e12, 0.3e12),
    "T4": (0.25e12, 0.32e12),
}
SIZE = 9
# Of a lane between two steps: its times, state and slope, the controller's memory, counts.
CARRIED = 8 * (2 + 2 * SIZE + 4) + 4 * 4
LANES, LOOP, CHAIN = 1 << 20, 64, 64


class Peak(NamedTuple):
    """Operations and bytes a second that a device is capable of, and how that is known."""

    operations: float
    bytes: float
    source: str


class StepCost(NamedTuple):
    """What a step of one run takes: operations of its right-hand sides and of its sums, bytes.

    ``carried`` is what goes to memory and back at least once a step. ``stages`` is what goes there if each stage is a
    kernel of its own, which reads the slopes so far and writes one.
    """

    kinds: dict[str, int]
    operations: int
    carried: int
    stages: int


def step_cost() -> StepCost:
    """A step of Dopri8 on the paper's ball."""
    kinds = kinds_of(right_hand_side(paper.ball()))
    tableau = DEFAULT_SOLVER.tableau
    used = sum(int(np.count_nonzero(row)) for row in tableau.a_lower) + int(np.count_nonzero(tableau.b_error))
    evaluation = sum(WEIGHTS.get(kind, 1) * count for kind, count in kinds.items())
    reads = sum(range(1, EVALUATIONS + 1)) + EVALUATIONS  # slopes so far, and the state
    return StepCost(
        kinds, EVALUATIONS * evaluation + 2 * SIZE * used, 2 * CARRIED, 2 * CARRIED + 8 * SIZE * (reads + EVALUATIONS)
    )


def kinds_of(program) -> dict[str, int]:
    """How often each operation occurs in a call of a program whose parameters are prepared, the most frequent first."""
    ball = [number for leaf in jax.tree.leaves(paper.ball()) for number in np.asarray(leaf).reshape(-1)]
    prepared = program.prepare([jnp.asarray(number) for number in ball])
    # Without lanes nothing is made separate, which costs moves and no arithmetic.
    call = jax.make_jaxpr(lambda t, x: program(prepared, [t, *x]))(jnp.zeros(()), jnp.zeros(SIZE))
    names = (equation.primitive.name for equation in call.jaxpr.eqns)
    return dict(collections.Counter(name for name in names if name not in MOVES).most_common())


def peak() -> Peak:
    """Of the first device: by its name where that is known, otherwise as measured."""
    name = jax.devices()[0].device_kind
    for known, (operations, bandwidth) in PEAKS.items():
        if known in name:
            return Peak(operations, bandwidth, f"data sheet of the {known}")
    return measured_peak(LANES)


def measured_peak(lanes: int) -> Peak:
    """By a chain of products with sums in each of ``lanes``, and by sums of two long arrays."""
    x = jnp.linspace(0.0, 1.0, lanes)

    @jax.jit
    def chain(x):
        def link(_, x):
            for _ in range(CHAIN):
                x = 0.999 * x + 1e-3
            return x

        return jax.lax.fori_loop(0, LOOP, link, x)

    add = jax.jit(lambda x, y: x + y)
    return Peak(2 * lanes * LOOP * CHAIN / _best(chain, x), 3 * x.nbytes / _best(add, x, x), "measured")


def describe_device() -> dict:
    """The device's name, its peak, and a step's cost."""
    return {
        "device": jax.devices()[0].device_kind,
        "peak": peak()._asdict(),
        "measured_peak": measured_peak(LANES)._asdict(),
        "step": step_cost()._asdict(),
    }


def _best(function, *arguments) -> float:
    return harness.interleaved_best({"": lambda: jax.block_until_ready(function(*arguments))}, rounds=5)[""]
