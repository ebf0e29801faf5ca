"""Ctrl-C and SIGTERM at random moments over all commands, each ended within a minute.

python -m tests.cli.interrupted COUNT SEED prints how each ended, and the median and longest time until it had.
"""

import collections
import os
import random
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

from jaxball.files.scenario.sources import builtin_text
from tests.support.scripts import BENCHMARKS

EXAMPLES = Path(__file__).parents[2] / "examples"
STUDY = """
format = 1
scenario = "disk"
chunk = 16

[[axes]]
path = "body.mass"
linear = { from = 1, to = 2, count = 4000 }
"""
# What makes the files that some commands read.
BEFORE = (
    ("simulate", "ball.toml", "--set", "time.step=0.001", "--out", "run.nc"),
    ("sweep", "small.toml", "--out", "done.zarr"),
)
COMMANDS = {
    ("scenarios",): 2,
    ("simulate", "ball.toml", "--out", "run.nc", "--plot", "figures"): 20,
    ("simulate", "disk", "--animate", "film.gif", "--out", "run.csv"): 25,
    ("chaos", "ball", "--plot", "means.png"): 20,
    ("verify", "disk", "--json", "report.json"): 20,
    ("stability", "ball.toml", "--rate", "1", "--plot", "eigenvalues.png"): 15,
    ("plot", "run.nc", "--out", "drawn", "--format", "png", "pdf", "svg"): 20,
    ("view", "run.nc", "--out", "view.html"): 10,
    ("sweep", "plot", "done.zarr", "--out", "drawn"): 10,
    ("sweep", "status", "done.zarr"): 5,
    ("periodic", "roboball", "--after", "20", "--period", "3", "--plot", "multipliers.png"): 25,
    ("track", "ball.toml", "--sample", "0.1", "--plot", "held"): 40,
    ("validate", "ball.toml", "study.toml"): 8,
    ("reproduce", "--out", "out"): 25,
    ("reproduce", "--solvers", "--out", "out"): 25,
    ("benchmarks", "--quick", "--out", "bench"): 25,
    ("sweep", "study.toml", "--out", "s.zarr"): 25,
    ("sweep", "study.toml", "--out", "s.zarr", "--workers", "2"): 25,
    ("sweep", "study.toml", "--dry-run"): 15,
    ("design", str(EXAMPLES / "problem_rail_shape.toml"), "--out", "design"): 30,
    ("design", str(EXAMPLES / "problem_disk_control.toml"), "--out", "design"): 30,
}
# A sweep ends when its chunk does, or at the second Ctrl-C, which is pressed as late as this.
PATIENCE = 10.0
LONGEST = 60.0


class Ending(NamedTuple):
    """How a command ended, how long after the signal, and what it said."""

    how: str
    seconds: float
    errors: str


def interrupted(folder: Path, arguments: tuple[str, ...], moment: float, number: int = signal.SIGINT) -> Ending:
    """How a command ends that gets a signal ``moment`` seconds after its start."""
    program = [str(BENCHMARKS), *arguments[1:]] if arguments[0] == "benchmarks" else ["-m", "jaxball", *arguments]
    command = [sys.executable, *program]
    with (folder / "output").open("w") as output, (folder / "errors").open("w") as errors:
        process = subprocess.Popen(command, cwd=folder, stdout=output, stderr=errors, start_new_session=True)
    time.sleep(moment)
    ended_before = process.poll() is not None
    pressed = time.monotonic()
    press(process, number)
    try:
        process.wait(PATIENCE if "Stopping" in said(folder, 0.5) else LONGEST)
        seconds = time.monotonic() - pressed
    except subprocess.TimeoutExpired:
        pressed = time.monotonic()
        press(process, number)
        seconds = PATIENCE
        if "Stopping" in said(folder):
            process.wait(LONGEST)
            seconds = time.monotonic() - pressed
    # What was killed is gone a moment later.
    deadline = time.monotonic() + 5.0
    while (alive := press(process, 0)) and time.monotonic() < deadline:
        time.sleep(0.01)
    press(process, signal.SIGKILL)
    return Ending(judged(folder, process, ended_before, alive, number), seconds, said(folder))


def press(process: subprocess.Popen, number: int) -> bool:
    """Sends a signal to all processes of a command, as a terminal does; False where there are none."""
    try:
        os.killpg(process.pid, number)
    except ProcessLookupError:
        return False
    return True


def said(folder: Path, patience: float = 0.0) -> str:
    """What a command wrote to stderr but for its progress, within ``patience`` seconds."""
    deadline = time.monotonic() + patience
    while True:
        text = (folder / "errors").read_text()
        if "jaxball: " in text or time.monotonic() >= deadline:
            return text
        time.sleep(0.01)


def judged(folder: Path, process: subprocess.Popen, ended_before: bool, alive: bool, number: int) -> str:
    """In a few words, how a command ended; the first of them is good or bad."""
    text, code = said(folder), process.returncode
    sentences = text.count("jaxball: ")
    left = [path.name for path in folder.rglob(".part-*")]
    if ended_before:
        return "good: it had ended before"
    if code is None or alive:
        return "bad: something of it runs on"
    if left and "Stopping" not in text:
        return f"bad: it left {', '.join(left)}"
    if code == 128 + number and sentences in (1, 2) and "Traceback" not in text and "Stopp" in text:
        return f"good: one sentence, {code}" if sentences == 1 else f"good: stopping, then one sentence, {code}"
    if code in (1, -number) and (not text or "KeyboardInterrupt" in text) and "/jaxball/" not in text:
        return "good: Python itself was starting, and nothing of this package had been reached"
    if code == 0 and sentences == text.count("jaxball: Stopping"):
        return "good: it came to its end meanwhile"
    return f"bad: exit code {code}"


def main() -> None:
    """Gives so many signals."""
    signal.signal(signal.SIGINT, signal.default_int_handler)  # which a shell's background jobs ignore
    count, moments = int(sys.argv[1]), random.Random(sys.argv[2])
    endings = []
    with tempfile.TemporaryDirectory() as top:
        prepared = Path(top) / "prepared"
        prepare(prepared)
        for k in range(count):
            arguments, longest = list(COMMANDS.items())[k % len(COMMANDS)]
            folder = Path(shutil.copytree(prepared, Path(top) / str(k)))
            moment = moments.uniform(0.0, longest if moments.random() < 0.7 else 3.0)
            number = moments.choice([signal.SIGINT, signal.SIGINT, signal.SIGTERM])
            ending = interrupted(folder, arguments, moment, number)
            shutil.rmtree(folder)
            endings.append(ending)
            words = " ".join(arguments[:2])
            print(f"{moment:5.1f} s {words}, {number.name}: {ending.how}, {ending.seconds:.2f} s", flush=True)
            if ending.how.startswith("bad"):
                print(ending.errors, flush=True)
    for how, times in collections.Counter(ending.how for ending in endings).most_common():
        print(f"{times:4} {how}")
    seconds = [ending.seconds for ending in endings if "sentence" in ending.how]
    print(f"until it had ended: median {statistics.median(seconds):.2f} s, longest {max(seconds):.2f} s")


def prepare(folder: Path) -> None:
    """What the commands read."""
    folder.mkdir()
    (folder / "ball.toml").write_text(builtin_text("ball"))
    (folder / "study.toml").write_text(STUDY)
    (folder / "small.toml").write_text(STUDY.replace("4000", "40"))
    for arguments in BEFORE:
        subprocess.run([sys.executable, "-m", "jaxball", *arguments], cwd=folder, check=True, capture_output=True)


if __name__ == "__main__":
    main()
