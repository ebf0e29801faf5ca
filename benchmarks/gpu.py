"""A million perturbed copies of the paper's ball on a GPU in float64, beside plain diffrax there and heyoka here.

    python benchmarks/gpu.py [--rows 1000000] [--json FILE]

Where JAX finds no GPU it says so and ends.
"""

import argparse

import contest
import harness
import turns
import work_precision
from turns import Contender

OURS, HEYOKA = "jaxball, simulate_ensemble", "heyoka, 8 lanes, on the CPU"
TOLERANCES = (1e-5, 1e-6, 1e-7, 1e-9, 1e-10, 1e-11)
GOALS = (1e-6, 1e-10)
REFERENCES = {HEYOKA: 1e-15, OURS: 1e-13}


def main() -> None:
    options = _options()
    reason = turns.apart(why_no_gpu)
    if reason:
        print(f"No GPU was measured, because {reason}; run this where there is one, with the JAX that is made for it.")
        return
    cores = harness.cores()
    contenders = [
        Contender(HEYOKA, "peers.heyoka_batch:Batch", min(options.rows, options.rows_cpu)),
        Contender(OURS, "jaxball_batch:Ensemble", options.rows, cpu_settings=False, gpu=True),
        Contender("diffrax, jax.vmap", "peers.diffrax_batch:Batch", options.rows, cpu_settings=False, gpu=True),
    ]
    device = turns.apart(name_of_device)
    measured = contest.measure(contenders, options.rows, options.tolerances, options.rounds, cores, REFERENCES)
    harness.set_up_jax(cpu_settings=False)
    content = {
        "benchmark": "copies of the paper's ball with perturbed q and Omega on a GPU, from t = 0 to 20",
        **harness.description("heyoka"),
        "cores": cores,
        "device": device,
        **measured,
        "at_equal_error": work_precision.at_equal_error(measured["rows"], OURS, GOALS),
    }
    report(content)
    harness.write_json(options.json, content)


def why_no_gpu() -> str:
    """Why JAX has no GPU; empty where it has one."""
    harness.set_up_jax(cpu_settings=False, gpu=True)
    import jax

    try:
        platforms = {device.platform for device in jax.devices()}
    except (RuntimeError, AssertionError):  # the latter where JAX_PLATFORMS names what is not installed
        return "JAX cannot start a GPU here"
    return "" if platforms & {"gpu", "cuda", "rocm"} else "JAX finds no GPU here"


def name_of_device() -> str:
    """The name of the first device, in a process with the GPU."""
    harness.set_up_jax(cpu_settings=False, gpu=True)
    import jax

    return jax.devices()[0].device_kind


def report(content: dict) -> None:
    """Prints the device, all rows, and the ratios."""
    print(f"{content['device']}.")
    work_precision.report(content["rows"], content["at_equal_error"], OURS)
    print(contest.agreement_sentence(content["agreement"]))


def _options() -> argparse.Namespace:
    parser = contest.parser(__doc__ or "", 1_000_000, TOLERANCES, rounds=3)
    parser.add_argument("--rows-cpu", type=int, default=100_000, help="how many of them for heyoka")
    return parser.parse_args()


if __name__ == "__main__":
    main()
