"""How well lanes are used where runs differ in length, and what thirty masses cost beside three.

    python benchmarks/refill.py [--rows 10000] [--json FILE]

Spread: the spans of runs are log-uniform from 2 to 20 and, in a second sweep, the tolerances from 1e-4 to 1e-10 too.
Efficiency is the share of the executed steps of lanes that belong to a run; beside it, the share that a loop
would have which waits for its longest run, as ``jax.vmap`` of one run does.

Masses: each of the paper's three is split into ten, so both balls move alike and take the same steps. On one
core, a run's time for each evaluation of the right-hand side in each lane is set beside that of steps without
control, of steps that evaluate no more than the moments, and of steps that evaluate nothing.
"""

import harness
import numpy as np
import perturbed

SHORTEST, LONGEST = 2.0, 20.0
COARSEST, FINEST = 1e-4, 1e-10
TOLERANCE = 1e-10
TARGET = 0.85
SPLIT = 10  # parts of each mass
# Steps of equal length in a loop, by what is evaluated at each stage: names in ``lane_costs``.
PARTS = {
    "right_hand_side": "steps without control",
    "moments_alone": "steps that evaluate no more than moments",
    "nothing_at_all": "steps that evaluate nothing",
}


def main() -> None:
    options = harness.parser(__doc__ or "", rows=10_000, rounds=5).parse_args()
    harness.set_up_jax(cpu_settings=True)
    content = {
        "benchmark": "runs of different lengths in refilled lanes, and runs with 3 and 30 masses",
        **harness.description(),
        "spread": [spread(options.rows, tolerances) for tolerances in (False, True)],
        "masses": masses(options.rows, options.rounds),
    }
    for found in content["spread"]:
        met = "at least" if found["efficiency"] >= TARGET else "below"
        print(
            f"{found['sweep']}: {found['fewest']} to {found['most']} steps, efficiency {found['efficiency']:.1%}, "
            f"{met} {TARGET:.0%}; without refilling {found['without_refilling']:.1%}."
        )
    _print_masses(content["masses"])
    harness.write_json(options.json, content)


def spread(rows: int, tolerances: bool) -> dict:
    """Efficiency where the runs' numbers of steps are spread; the fewest and most are without 1 % at either end."""
    import jax
    from jaxball_batch import at

    from jaxball import paper
    from jaxball.ensemble import simulate_ensemble

    random = np.random.default_rng(perturbed.SEED)
    times = np.stack([np.zeros(rows), _log_uniform(random, SHORTEST, LONGEST, rows)], axis=1)
    tolerance = _log_uniform(random, FINEST, COARSEST, rows) if tolerances else np.full(rows, TOLERANCE)
    ensemble = simulate_ensemble(
        paper.ball(), times, at(*perturbed.initial(rows)), rtol=tolerance, atol=tolerance, in_axes=(None, 0)
    )
    steps = np.asarray(jax.device_get(ensemble.trajectory.steps))
    fewest, most = np.percentile(steps, (1, 99)).round().astype(int).tolist()
    return {
        "sweep": "Spans and tolerances log-uniform" if tolerances else "Spans log-uniform",
        "rows": rows,
        "fewest": fewest,
        "most": most,
        "efficiency": float(ensemble.efficiency),
        "without_refilling": float(steps.mean() / steps.max()),
        "failed": int(np.sum(np.asarray(ensemble.trajectory.status) != 0)),
    }


def masses(rows: int, rounds: int) -> list[dict]:
    """For 3 and 30 masses: steps, seconds, and nanoseconds of an evaluation in a lane, in runs and in their parts."""
    import lane_costs
    from many_masses import split

    from jaxball import paper

    balls = [paper.ball(), split(paper.ball(), SPLIT)]
    runs = [lane_costs.Runs(ball, rows, TOLERANCE) for ball in balls]
    calls = {("run", k): run for k, run in enumerate(runs)}
    calls |= {
        (part, k): lane_costs.Stages(getattr(lane_costs, part)(ball), ball)
        for part in PARTS
        for k, ball in enumerate(balls)
    }
    best = harness.interleaved_best(calls, rounds)
    return [
        {
            "masses": ball.n_masses,
            "steps": run.steps,
            "time": best["run", k],
            "run": 1e9 * best["run", k] / run.evaluations,
            **{part: 1e9 * best[part, k] / lane_costs.Stages.count for part in PARTS},
        }
        for k, (ball, run) in enumerate(zip(balls, runs, strict=True))
    ]


def _print_masses(rows: list[dict]) -> None:
    few, many = rows
    print(
        f"\n{few['masses']} and {many['masses']} masses, {few['steps']} and {many['steps']} steps; "
        "for each evaluation in a lane:"
    )
    for key, name in {"run": "a run", **PARTS}.items():
        print(
            f"  {name:42}{few[key]:7.1f} ns{many[key]:8.1f} ns{many[key] - few[key]:+8.1f} ns"
            f"   × {many[key] / few[key]:.2f}"
        )
    alone = [row["moments_alone"] - row["nothing_at_all"] for row in rows]
    expected = (few["run"] + alone[1] - alone[0]) / few["run"]
    print(
        f"The moments take {alone[0]:.1f} and {alone[1]:.1f} ns, × {alone[1] / alone[0]:.2f}. "
        f"With the rest of a run as it is, that makes × {expected:.2f} of a run."
    )


def _log_uniform(random: np.random.Generator, low: float, high: float, rows: int) -> np.ndarray:
    return np.exp(random.uniform(np.log(low), np.log(high), rows))


if __name__ == "__main__":
    main()
