"""What the gallery shows of a scenario and of an example, made in processes of their own: no Sphinx here."""

import os
import subprocess
import sys
from pathlib import Path

FRAMES = 400  # of a view, at least: a scenario saves as often as its figures need


def draw_scenario(text: str, folder: Path) -> None:
    """Its overview, its thumbnail, and its view where there is one of such systems."""
    import jax

    import jaxball.cpu

    jaxball.cpu.prepare()
    jax.config.update("jax_enable_x64", True)
    import dataclasses

    import numpy as np

    from jaxball import read_scenario
    from jaxball.plot.view.document import kind_of

    from .thumbnails import write_overview, write_thumbnail

    scenario = read_scenario(text)
    if len(scenario.times) < FRAMES:
        finer = np.linspace(scenario.times[0], scenario.times[-1], FRAMES + 1)
        scenario = dataclasses.replace(scenario, times=finer)
    run = scenario.simulate(throw=True)
    write_overview(run, scenario.title, folder)
    write_thumbnail(scenario, run, folder)
    if kind_of(run) is not None:
        run.view(folder / "view.html", title=scenario.title)


def run_example(script: Path, folder: Path) -> None:
    """What it prints, and the files that it writes."""
    settings = {**os.environ, "JAX_DISABLE_MOST_OPTIMIZATIONS": "1"}
    done = subprocess.run([sys.executable, script], cwd=folder, env=settings, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"{script.name} failed:\n{done.stderr}")
    (folder / "printed.txt").write_text(done.stdout)
