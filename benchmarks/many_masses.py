"""A run of the ball with 3 and with 30 masses, beside the cost of their moments alone.

    python benchmarks/many_masses.py [--json FILE]

Each of the paper's three masses is split into ten of a tenth of its mass in the same place, so both
balls move alike and take the same steps. What the second run takes longer should be its evaluations of
the right-hand side times what 30 masses' moments take longer than those of 3.
"""

import argparse
from pathlib import Path

import harness

SPLIT = 10
LOOP = 1000


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", type=Path, help="where to write the measurements")
    options = parser.parse_args()
    harness.set_up_jax(cpu_settings=True)
    content = {
        "benchmark": "the paper's ball with every mass whole and with every mass split into ten",
        **harness.description("jaxball", "jax", "jaxlib", "diffrax", "equinox"),
        **measure(),
    }
    for row in content["rows"]:
        print(
            f"{row['masses']:3} masses: {1e6 * row['run_time']:.0f} us for {row['evaluations']} evaluations, "
            f"moments alone {1e6 * row['moments_time']:.3f} us an evaluation"
        )
    print(f"The run with more masses takes {1e6 * content['run_difference']:.0f} us longer; ", end="")
    print(f"their moments alone take {1e6 * content['moments_difference']:.0f} us longer.")
    if options.json:
        harness.write_json(options.json, content)


def measure() -> dict:
    """Times in seconds of one run and of one evaluation of the moments, for both balls."""
    from jaxball import paper

    balls = {1: paper.ball(), SPLIT: split(paper.ball(), SPLIT)}
    calls = {("run", parts): run(ball) for parts, ball in balls.items()}
    calls |= {("moments", parts): moments_loop(ball) for parts, ball in balls.items()}
    medians = harness.interleaved_medians(calls)
    rows = [
        {
            "masses": ball.n_masses,
            "run_time": medians["run", parts],
            "moments_time": medians["moments", parts] / LOOP,
            "evaluations": evaluations(ball),
        }
        for parts, ball in balls.items()
    ]
    few, many = rows
    return {
        "rows": rows,
        "run_difference": many["run_time"] - few["run_time"],
        "moments_difference": (many["moments_time"] - few["moments_time"]) * many["evaluations"],
    }


def split(ball, parts: int):
    """The same ball with every mass made of ``parts`` equal ones in one place."""
    from jaxball import Ball, PointMass

    masses = [PointMass(item.mass / parts, item.motion) for item in ball.point_masses for _ in range(parts)]
    return Ball(mass=ball.mass, inertia=ball.inertia, radius=ball.radius, offset=ball.offset, masses=masses)


def run(ball):
    """A compiled run from t = 0 to 20 by the default settings."""
    import jax

    from jaxball import paper, simulate

    solve = jax.jit(lambda ball: simulate(ball, (paper.START, paper.END)).state.z[-1])
    return lambda: jax.block_until_ready(solve(ball))


def moments_loop(ball):
    """A compiled loop that does nothing but evaluate the moments ``LOOP`` times."""
    import jax
    import jax.numpy as jnp
    from jax.flatten_util import ravel_pytree

    from jaxball.physics.moments import velocity_moments

    @jax.jit
    def loop(ball):
        parameters, unpack = ravel_pytree(ball.prepare())
        nothing = jnp.zeros(0)

        def at(t):
            return ravel_pytree(velocity_moments(unpack(parameters), t, (nothing, nothing)))[0]

        return jax.lax.fori_loop(0, LOOP, lambda k, total: total + at(20 * k / LOOP), at(jnp.asarray(0.0)))

    return lambda: jax.block_until_ready(loop(ball))


def evaluations(ball) -> int:
    """How often a run by the default settings evaluates the right-hand side."""
    from jaxball import paper, simulate
    from jaxball.paper.reproduce.evaluations import Counter, CountingSolver
    from jaxball.simulation.arguments import DEFAULT_SOLVER

    counter = Counter()
    simulate(ball, (paper.START, paper.END), solver=CountingSolver(DEFAULT_SOLVER, counter), throw=True)
    return counter.read()


if __name__ == "__main__":
    main()
