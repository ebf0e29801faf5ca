"""A million perturbed copies of the paper's ball on a GPU in float64, beside plain diffrax there and heyoka here.

    python benchmarks/gpu.py [--rows 1000000] [--json FILE]

Where JAX finds no GPU it says so and ends. The floor is the least time by the device's arithmetic or by its
memory, whichever is longer; ``floors.py`` says what is counted.
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
    found = turns.apart(device)
    measured = contest.measure(contenders, options.rows, options.tolerances, options.rounds, cores, REFERENCES)
    steps = turns.apart(mean_steps, options.tolerances)
    for row in measured["rows"]:
        if row["solver"] == OURS:
            row["floor"] = floor(found, steps[row["tolerance"]] * row["rows"])
    harness.set_up_jax(cpu_settings=False)
    content = {
        "benchmark": "copies of the paper's ball with perturbed q and Omega on a GPU, from t = 0 to 20",
        **harness.description("heyoka"),
        "cores": cores,
        **found,
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


def device() -> dict:
    """As ``floors.describe_device``, in a process with the GPU."""
    harness.set_up_jax(cpu_settings=False, gpu=True)
    import floors

    return floors.describe_device()


def mean_steps(tolerances: tuple[float, ...]) -> dict[float, float]:
    """Steps of a run at each tolerance, by the first thousand."""
    harness.set_up_jax(cpu_settings=True)
    import lane_costs

    from jaxball import paper

    rows = 1000
    return {tolerance: lane_costs.Runs(paper.ball(), rows, tolerance).steps / rows for tolerance in tolerances}


def floor(found: dict, steps: float) -> dict[str, float]:
    """The least seconds for so many steps: by arithmetic, by what is carried, by kernels of single stages."""
    peak, step = found["peak"], found["step"]
    return {
        "arithmetic": steps * step["operations"] / peak["operations"],
        "memory": steps * step["carried"] / peak["bytes"],
        "memory_by_stages": steps * step["stages"] / peak["bytes"],
    }


def report(content: dict) -> None:
    """Prints the device, all rows, the ratios, and the floor's share of our time."""
    peak, step = content["peak"], content["step"]
    print(
        f"{content['device']}: {peak['operations']:.2e} operations and {peak['bytes']:.2e} bytes a second, "
        f"{peak['source']}."
    )
    kinds = ", ".join(f"{count} {kind}" for kind, count in step["kinds"].items())
    print(f"A right-hand side: {kinds}. A step: {step['operations']} operations, {step['carried']} bytes.")
    work_precision.report(content["rows"], content["at_equal_error"], OURS)
    for row in content["rows"]:
        if "floor" in row:
            shares = ", ".join(
                f"{name.replace('_', ' ')} {seconds / row['time']:.1%}" for name, seconds in row["floor"].items()
            )
            print(f"Tolerance {row['tolerance']:.0e}, the floor's share of the time: {shares}.")
    print(contest.agreement_sentence(content["agreement"]))


def _options() -> argparse.Namespace:
    parser = contest.parser(__doc__ or "", 1_000_000, TOLERANCES, rounds=3)
    parser.add_argument("--rows-cpu", type=int, default=100_000, help="how many of them for heyoka")
    return parser.parse_args()


if __name__ == "__main__":
    main()
