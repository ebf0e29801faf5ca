"""How many runs a second are solved where each of them may slide, roll, fly and bounce, beside runs that roll.

    python benchmarks/modes.py [--rows 10000] [--json FILE]

The same balls, each with an offset of its own, at the same times: without a law of contact; in the air all the time;
and with friction and restitution such that rows slide, roll, fly and bounce. A microsecond for a lane's step says what
a step costs, and the number of steps what modes add to that. Balls without masses, whose equations are as short as can
be, and the paper's ball with its three masses.
"""

import harness
import numpy as np

TIMES = (0.0, 2.0)
SEED = 1
HIGH = 100.0
ROOM = 16
SPREAD = 0.1  # of the offsets


def main() -> None:
    options = harness.parser(__doc__ or "", rows=10_000, rounds=3).parse_args()
    harness.set_up_jax(cpu_settings=True)
    from jaxball import Ball, load_scenario

    alone = Ball(mass=1.0, inertia=(0.4, 0.45, 0.5), radius=1.0, gravity=9.81)
    bodies = {"no masses": alone, "three masses": load_scenario("ball").system}
    rows = [
        {"body": name} | row for name, body in bodies.items() for row in measured(body, options.rows, options.rounds)
    ]
    for row in rows:
        print(
            f"{row['body']:14}{row['runs']:22}{row['rate']:9.0f} runs/s{row['steps']:8.1f} steps"
            f"{row['switches']:7.1f} switches"
            f"{row['lane_step']:8.2f} us a lane's step, efficiency {row['efficiency']:.0%}, {row['failed']} failed"
        )
    content = {"benchmark": "runs of several modes in lanes", **harness.description(), "rows": rows}
    harness.write_json(options.json, content)


def measured(body, rows: int, rounds: int) -> list[dict]:
    """What every kind of runs of a body costs."""
    import equinox as eqx
    import jax

    from jaxball import BallState, Contact
    from jaxball.physics import ReleasedState
    from jaxball.simulation.ensemble import simulate_ensemble

    def ball(offset):
        return eqx.tree_at(lambda one: one.offset, body, offset)

    def thrown(q, Omega, V, height):
        return ReleasedState(BallState(q=q, Omega=Omega), V=V, height=height)

    def law(sliding, restitution):
        return Contact(friction=sliding, restitution=restitution, capacity=ROOM)

    random = np.random.default_rng(SEED)
    falls = random.random(rows) < 0.5
    q, Omega, V = (random.normal(size=(rows, n)) for n in (4, 3, 3))
    V[:, 2] *= falls
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    balls = jax.vmap(ball)(SPREAD * random.normal(size=(rows, 3)))
    height = np.where(falls, random.uniform(0.0, 0.5, rows), 0.0)
    starts = [jax.vmap(thrown)(q, 3 * Omega, V, h) for h in (height, height + HIGH)]
    mu, e = random.uniform(0.02, 0.8, rows), random.choice([0.0, 0.3, 0.7, 0.9], rows)
    laws = jax.vmap(law)(mu, e)
    runs = {
        "roll, without a law": (starts[0].body, None),
        "fly": (starts[1], laws),
        "of several modes": (starts[0], laws),
    }
    calls = {
        name: lambda state=state, contact=contact: jax.block_until_ready(
            simulate_ensemble(balls, TIMES, state, contact=contact, max_steps=4000)
        )
        for name, (state, contact) in runs.items()
    }
    ensembles = {name: call() for name, call in calls.items()}
    best = harness.interleaved_best(calls, rounds)
    return [_row(name, ensembles[name], best[name], rows) for name in calls]


def _row(name: str, ensemble, seconds: float, rows: int) -> dict:
    run = ensemble.trajectory
    return {
        "runs": name,
        "rate": rows / seconds,
        "steps": float(np.mean(run.steps)),
        "switches": 0.0 if run.contact is None else float(np.mean(run.contact.switches.count)),
        "lane_step": 1e6 * seconds * harness.cores() / float(ensemble.executed),
        "efficiency": float(ensemble.efficiency),
        "failed": int(np.sum(np.asarray(run.status) != 0)),
    }


if __name__ == "__main__":
    main()
