"""A run of a ball with rotors: rings of 3 masses and of 30, and one, two and four rings.

    python benchmarks/rings.py [--json FILE]

A ring of any number of masses moves alike, so runs with one ring take the same steps. What more masses take longer
should be the evaluations of the right-hand side times what their sums take longer. More rings are other balls: an
evaluation should cost in proportion to their number, beside what it costs without any.
"""

import time

import harness

AXES = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (1.0, 1.0, 1.0))
CASES = ((0, 0), (1, 3), (1, 30), (2, 3), (4, 3))  # rings, and masses of each
END, LOOP = 20.0, 1000


def main() -> None:
    options = harness.parser(__doc__ or "").parse_args()
    harness.set_up_jax(cpu_settings=True)
    content = {
        "benchmark": "a ball with rotors that are rings of point masses",
        **harness.description(),
        "rows": measure(),
    }
    for row in content["rows"]:
        print(
            f"{row['rings']} rings of {row['masses']:2} masses: {1e6 * row['run_time']:6.0f} us for "
            f"{row['evaluations']} evaluations, {1e6 * row['evaluation_time']:.3f} us each, of which sums over masses "
            f"{1e6 * row['sums_time']:.3f} us; compiled in {row['build_time']:.1f} s of processor time"
        )
    few, many = (row for row in content["rows"] if row["rings"] == 1)
    more = 1e6 * (many["run_time"] - few["run_time"])
    sums = 1e6 * (many["sums_time"] - few["sums_time"]) * many["evaluations"]
    print(f"A run with {many['masses']} masses takes {more:.0f} us longer than one with {few['masses']}; ", end="")
    print(f"their sums alone take {sums:.0f} us longer.")
    harness.write_json(options.json, content)


def measure() -> list[dict]:
    """Times in seconds, one row for each case: of a run, an evaluation, its sums, and of compiling a run."""
    from jaxball_ball import evaluations

    from jaxball.simulation.arguments import DEFAULT_SOLVER

    robots = {case: robot(*case) for case in CASES}
    builds = {case: built(*robots[case]) for case in CASES}
    calls = {("run", case): call for case, (call, _) in builds.items()}
    calls |= {("evaluation", case): evaluations_loop(*robots[case]) for case in CASES}
    calls |= {("sums", case): sums_loop(*robots[case]) for case in CASES}
    medians = harness.interleaved_medians(calls)
    return [
        {
            "rings": case[0],
            "masses": case[1],
            "run_time": medians["run", case],
            "evaluation_time": medians["evaluation", case] / LOOP,
            "sums_time": medians["sums", case] / LOOP,
            "evaluations": evaluations(DEFAULT_SOLVER, robots[case][0], (0.0, END), robots[case][1]),
            "build_time": builds[case][1],
        }
        for case in CASES
    ]


def robot(rings: int, masses: int):
    """A ball that is not balanced, and its start, with rings of 0.2 that spin freely."""
    from jaxball import Ball, BallState, ring_rotor

    rotors = [ring_rotor(0.2, 0.5, axis=axis, count=masses) for axis in AXES[:rings]]
    ball = Ball(mass=1.0, inertia=(0.4, 0.45, 0.5), offset=(0.0, 0.0, -0.1), mechanisms=rotors)
    return ball, BallState(Omega=(0.5, 1.0, 0.3), theta=[0.0] * rings, thetadot=[3.0] * rings)


def built(ball, state):
    """A compiled run from t = 0 by the default settings, and the processor time that tracing and compiling took."""
    import jax

    from jaxball import simulate

    before = time.process_time()
    solve = jax.jit(lambda ball, state: simulate(ball, (0.0, END), state).state.z[-1]).lower(ball, state).compile()
    return lambda: jax.block_until_ready(solve(ball, state)), time.process_time() - before


def evaluations_loop(ball, state):
    """A compiled loop that does nothing but evaluate the right-hand side ``LOOP`` times, by a point that moves."""
    return _loop(ball, state, lambda ball, t, state: ball.field_of_packed(t, state))


def sums_loop(ball, state):
    """The same of the sums over masses in it: moments, and the joints' inertia and its rate."""
    import jax.numpy as jnp

    from jaxball.physics.dynamics.coupling import inertia, inertia_rate, linkages
    from jaxball.physics.dynamics.moments import velocity_moments

    def sums(ball, t, state):
        links = linkages(ball, t, (state.theta, state.thetadot, state.thetadot))
        r, Gamma, nothing = ball.radius, state.Gamma, jnp.zeros((3, 3))
        at = velocity_moments(ball, t, (state.theta, state.thetadot), links)
        return at, inertia(nothing, r, Gamma, links), inertia_rate(nothing, r, Gamma, state.Omega, links)

    return _loop(ball, state, sums)


def _loop(ball, state, function):
    import jax
    from jaxball_ball import loop

    def moved(t, ball, state):
        return function(ball, t, jax.tree.map(lambda leaf: leaf + 1e-3 * t, state))

    return loop(LOOP, moved, ball.prepare(), state)


if __name__ == "__main__":
    main()
