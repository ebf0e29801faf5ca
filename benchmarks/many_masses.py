"""Runs of the ball with 3, 30 and 300 masses by Dopri8 and by Adams, beside the cost of their moments alone.

    python benchmarks/many_masses.py [--json FILE]

Each of the paper's three masses is split into ten or a hundred parts of equal mass in the same place, so all balls move
alike and take the same steps. What a run with more masses takes longer should be its evaluations of the right-hand side
times what their moments take longer than those of 3; and a method that evaluates less often should gain by it.
"""

import harness

PARTS = (1, 10, 100)
# At equal tolerances Adams has the larger error: at the tighter one it is about as large as that of Dopri8.
SETTINGS = (("Dopri8", 1e-10), ("Adams", 1e-10), ("Adams", 1e-12))
LOOP = 1000


def main() -> None:
    options = harness.parser(__doc__ or "").parse_args()
    harness.set_up_jax(cpu_settings=True)
    content = {
        "benchmark": "the paper's ball with every mass whole, and split into ten and into a hundred",
        **harness.description(),
        **measure(),
    }
    print(f"{'Masses':>6}  {'Solver':8}{'Tolerance':>10}{'Evaluations':>12}{'Error':>9}{'Time':>11}{'Build':>8}")
    for row in content["rows"]:
        print(
            f"{row['masses']:>6}  {row['solver']:8}{row['tolerance']:>10.0e}{row['evaluations']:>12}"
            f"{row['error']:>9.0e}{1e6 * row['time']:>8.0f} us{row['build_time']:>6.1f} s"
        )
    for row in content["moments"]:
        print(
            f"{row['masses']} masses: the moments alone take {1e6 * row['time']:.3f} us an evaluation; a run by Dopri8 "
            f"takes {1e6 * row['run_longer']:.0f} us longer than with the fewest, and its moments "
            f"{1e6 * row['moments_longer']:.0f} us."
        )
    harness.write_json(options.json, content)


def measure() -> dict:
    """``rows``: one for each ball and setting. ``moments``: one for each ball, beside the one with the fewest masses.

    Times are in seconds; errors are those of (q, Omega, z) at t = 20.
    """
    from jaxball_ball import TIMES, evaluations

    from jaxball import paper
    from jaxball.paper import reference

    balls = {parts: split(paper.ball(), parts) for parts in PARTS}
    runs = {(parts, *setting): run(ball, *setting) for parts, ball in balls.items() for setting in SETTINGS}
    build_times = {key: harness.timed(call)[0] - harness.timed(call)[0] for key, call in runs.items()}
    loops = {("moments", parts): moments_loop(ball) for parts, ball in balls.items()}
    medians = harness.interleaved_medians({**runs, **loops}, rounds=20, block=5)
    exact = reference.ball().values[-1, -9:]
    rows = [
        {
            "masses": balls[parts].n_masses,
            "solver": solver,
            "tolerance": tolerance,
            "evaluations": evaluations(solver_named(solver), balls[parts], TIMES, rtol=tolerance, atol=tolerance),
            "error": float(max(abs(call() - exact))),
            "time": medians[parts, solver, tolerance],
            "build_time": build_times[parts, solver, tolerance],
        }
        for (parts, solver, tolerance), call in runs.items()
    ]
    return {"rows": rows, "moments": moments(rows, {parts: medians["moments", parts] / LOOP for parts in balls})}


def moments(rows: list[dict], times: dict[int, float]) -> list[dict]:
    """What runs by the first setting, and their moments alone, take longer than with the fewest masses."""
    first = [row for row in rows if (row["solver"], row["tolerance"]) == SETTINGS[0]]
    fewest = times[PARTS[0]]
    return [
        {
            "masses": row["masses"],
            "time": time,
            "run_longer": row["time"] - first[0]["time"],
            "moments_longer": (time - fewest) * row["evaluations"],
        }
        for row, time in zip(first, times.values(), strict=True)
    ]


def split(ball, parts: int):
    """The same ball with every mass made of ``parts`` equal ones in one place."""
    from jaxball import Ball, PointMass

    masses = [PointMass(item.mass / parts, item.motion) for item in ball.point_masses for _ in range(parts)]
    return Ball(mass=ball.mass, inertia=ball.inertia, radius=ball.radius, offset=ball.offset, masses=masses)


def solver_named(name: str):
    """A new solver of that name."""
    import diffrax

    from jaxball.simulation.solvers import Adams

    return {"Dopri8": diffrax.Dopri8, "Adams": Adams}[name]()


def run(ball, solver: str, tolerance: float):
    """A compiled run from t = 0 to 20, which returns (q, Omega, z) at its end."""
    import jax.numpy as jnp
    import numpy as np
    from jaxball_ball import TIMES, final

    import jaxball
    from jaxball import simulate

    method = solver_named(solver)
    solve = jaxball.jit(lambda ball, rtol: final(simulate(ball, TIMES, solver=method, rtol=rtol, atol=rtol).state, jnp))
    return lambda: np.asarray(solve(ball, tolerance))


def moments_loop(ball):
    """A compiled loop that does nothing but evaluate the moments ``LOOP`` times."""
    import jax.numpy as jnp
    from jaxball_ball import loop

    from jaxball.physics.dynamics.moments import velocity_moments

    nothing = jnp.zeros(0)
    return loop(LOOP, lambda t, ball: velocity_moments(ball, t, (nothing, nothing)), ball.prepare())


if __name__ == "__main__":
    main()
