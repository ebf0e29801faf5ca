"""What the gallery shows of a scenario and of an example, made in processes of their own: no Sphinx here."""

import os
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from jaxball import Scenario

FRAMES = 400  # of a view, at least: a scenario saves as often as its figures need


def draw_scenario(text: str, folder: Path) -> None:
    """Its overview, and its view where there is one of such systems."""
    scenario = _finer(text)

    from jaxball.plot.view.page import kind_of

    from .thumbnails import write_overview

    run = scenario.simulate(throw=True)
    write_overview(run, scenario.title, folder)
    if kind_of(run) is not None:
        run.view(folder / "view.html", title=scenario.title)


def draw_thumbnail(text: str, folder: Path) -> None:
    """Its thumbnail, of which the card of the gallery is made."""
    scenario = _finer(text)

    from .thumbnails import write_thumbnail

    write_thumbnail(scenario, scenario.simulate(throw=True), folder)


def _finer(text: str) -> "Scenario":
    """A scenario that saves often enough for a view."""
    import jax

    import jaxball.programs.cpu

    jaxball.programs.cpu.prepare()
    jax.config.update("jax_enable_x64", True)
    import dataclasses

    import numpy as np

    from jaxball import read_scenario

    scenario = read_scenario(text)
    if len(scenario.times) < FRAMES:
        finer = np.linspace(scenario.times[0], scenario.times[-1], FRAMES + 1)
        scenario = dataclasses.replace(scenario, times=finer)
    return scenario


def run_example(script: Path, folder: Path) -> None:
    """What it prints, and the files that it writes."""
    settings = {**os.environ, "JAX_DISABLE_MOST_OPTIMIZATIONS": "1"}
    done = subprocess.run([sys.executable, script], cwd=folder, env=settings, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"{script.name} failed:\n{done.stderr}")
    (folder / "printed.txt").write_text(done.stdout)
