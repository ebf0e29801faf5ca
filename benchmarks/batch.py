"""Perturbed copies of the paper's ball, thousands at a time: jaxball beside heyoka, numbalsoda and plain diffrax.

    python benchmarks/batch.py [--rows 10000] [--json FILE] [--figure FILE]

Every contender lives in a process of its own and uses all cores when its turn comes. What takes ten times
longer, diffrax and ``jax.vmap(simulate)``, is given the first 512 rows only.
"""

import argparse
from pathlib import Path

import contest
import harness
import work_precision
from turns import Contender

OURS, HEYOKA = "jaxball, simulate_ensemble", "heyoka, 8 lanes"
TOLERANCES = tuple(10.0**-k for k in range(4, 14))  # to 1e-13, because plain diffrax steps over the kinks
GOALS = (1e-6, 1e-10)
REFERENCES = {HEYOKA: 1e-15, OURS: 1e-13}
PACKAGES = ("numba", "numbalsoda", "heyoka")


def main() -> None:
    options = _options()
    cores = harness.cores()
    subset = min(options.subset, options.rows)
    contenders = [
        Contender(OURS, "jaxball_batch:Ensemble", options.rows),
        Contender(HEYOKA, "peers.heyoka_batch:Batch", options.rows),
        Contender("numbalsoda, DOP853", "peers.numba_batch:Batch", options.rows),
        Contender("jaxball, jax.vmap(simulate)", "jaxball_batch:Vmapped", subset),
        Contender("diffrax, jax.vmap", "peers.diffrax_batch:Batch", subset, cpu_settings=False),
    ]
    measured = contest.measure(contenders, options.rows, options.tolerances, options.rounds, cores, REFERENCES)
    harness.set_up_jax(cpu_settings=True)
    content = {
        "benchmark": "copies of the paper's ball with perturbed q and Omega; error of q, Omega, z at t = 20",
        **harness.description(*PACKAGES),
        "cores": cores,
        **measured,
        "at_equal_error": work_precision.at_equal_error(measured["rows"], OURS, GOALS),
    }
    work_precision.report(content["rows"], content["at_equal_error"], OURS)
    print("\n" + contest.agreement_sentence(content["agreement"]))
    harness.write_json(options.json, content)
    if options.figure:
        work_precision.draw(content["rows"], OURS, options.figure)


def _options() -> argparse.Namespace:
    parser = contest.parser(__doc__ or "", 10_000, TOLERANCES, rounds=5)
    parser.add_argument("--subset", type=int, default=512, help="how many of them for diffrax and jax.vmap(simulate)")
    parser.add_argument("--figure", type=Path, help="where to write a diagram, as PNG, PDF or SVG")
    return parser.parse_args()


if __name__ == "__main__":
    main()
