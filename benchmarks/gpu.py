"""Everything that is asked of a GPU, in one command of less than eight minutes.

    python benchmarks/gpu.py [--json FILE] [--figure FILE] [--budget 440] [--sections equality ball lorenz gradients]

- equality: programs with 64 rows on the GPU and on the CPU, compared to the last bit.
- ball: a thousand to ten million copies of the paper's ball, beside XLA and diffrax there, and heyoka on the CPU.
- lorenz: the table of GRADSOLVE (arXiv 2609.02876), beside that package, if it is installed, and diffrax.
- gradients: rows and their gradients per second.

What fails, hangs or ends its process is said and left out. Where JAX finds no GPU the script says so and ends. With
``--platform cpu --rows 8`` it can be tried anywhere.
"""

import argparse
import time
from pathlib import Path

import gpu_figure
import harness
from gpu_sections import SECTIONS, Session, say
from workers import Budget, LostError, Worker

TO_START = 90.0  # seconds


def main() -> None:
    options = _options()
    with Worker(options.platform) as card, Worker("cpu") as cpu:
        budget = Budget(options.budget)
        try:
            device = card.ask(min(TO_START, options.budget), "gpu_timings:device", options.platform == "cpu")
        except LostError as loss:
            device = {"reason": f"JAX cannot start a GPU here: {loss}"}
        if device["reason"]:
            print(f"No GPU was measured, because {device['reason']}; run this where there is one, with the JAX for it.")
            return
        say(f"{device['device']}, {device['platform_version']}".replace("\n", ", "))
        session = Session(budget, card, cpu, options.rows, options.programs)
        content = {
            "benchmark": "runs and gradients on a GPU, one run a thread",
            **{key: value for key, value in device.items() if key != "reason"},
            "budget": options.budget,
            "rows": options.rows,
            "sections": {},
            "losses": session.losses,
        }
        try:
            measure(session, options.sections, content, options.json)
        finally:
            harness.write_json(options.json, content)
    if options.figure is not None and content["sections"].get("ball", {}).get("rows"):
        gpu_figure.draw(content["sections"]["ball"]["rows"], content["device"], options.figure)


def measure(session: Session, sections: list[str], content: dict, path: Path | None) -> None:
    """Does one section after the other; what has been measured is written after each."""
    shares = [SECTIONS[name][1] for name in sections]
    for k, name in enumerate(sections):
        session.budget.begin_section(shares[k], shares[k + 1 :])
        start = time.monotonic()
        try:
            content["sections"][name] = SECTIONS[name][0](session)
        except Exception as error:  # a mistake in one section is no reason to lose the others
            session.lose(f"section {name}", f"{type(error).__name__}: {error}")
            content["sections"].setdefault(name, {})
        content["sections"][name]["seconds"] = time.monotonic() - start
        harness.write_json(path, content)
    count = len(session.losses)
    say(f"\n{session.budget.spent():.0f} s; {count} result{'' if count == 1 else 's'} missing.")


def _options() -> argparse.Namespace:
    parser = harness.parser(__doc__ or "", rows=10_000_000)
    parser.add_argument("--figure", type=Path, help="where to draw runs per second over rows, as PNG or PDF")
    parser.add_argument("--budget", type=float, default=440.0, help="seconds; what does not fit is left out")
    parser.add_argument("--sections", nargs="+", choices=SECTIONS, default=list(SECTIONS), metavar="NAME")
    parser.add_argument("--programs", nargs="+", default=(), metavar="NAME", help="compare these alone")
    parser.add_argument("--platform", choices=["gpu", "cpu"], default="gpu", help="cpu to try the script without a GPU")
    return parser.parse_args()


if __name__ == "__main__":
    main()
