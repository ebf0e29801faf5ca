"""Every Python block of the documentation runs, in order, and so does every example; maps show what there is."""

import argparse
import ast
import contextlib
import io
import os
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import jax
import numpy as np
import pytest
from sybil.example import SybilFailure

from jaxball import Status
from jaxball.analysis.verify.laws import LAWS
from jaxball.cli import main
from jaxball.cli.dispatch import parser_of
from tests.support.documents import agrees, examples_of
from tests.support.pictures import coarse

ROOT = Path(__file__).parents[2]
# Written by hand: what the site makes itself is not kept, and its parts are tested where they come from.
DOCUMENTS = [
    ROOT / "README.md",
    ROOT / "src/jaxball/programs/README.md",
    *(ROOT / name for name in ("docs/index.md", "docs/start.md")),
    *(page for room in ("tutorials", "how-to", "theory") for page in sorted((ROOT / "docs" / room).glob("*.md"))),
    *(ROOT / "docs" / "reference" / name for name in ("index.md", "files.md", "keys.md", "scenario-files.md")),
]
EXAMPLES = sorted((ROOT / "examples").glob("[0-9]*.py"))
FIRST_PAGES = ("README.md", "index.md", "start.md")
# Most of whose time is that of many solvers, of derivatives in both modes, or of long runs.
LONG_PAGES = (
    "changing-the-paper.md",
    "chaos-and-stability.md",
    "classical-systems.md",
    "comparing-solvers.md",
    "contact-and-events.md",
    "derivatives.md",
    "estimate.md",
    "extending.md",
    "files.md",
    "grounds.md",
    "holding-a-motion.md",
    "jax.md",
    "mechanisms.md",
    "own-nonholonomic-system.md",
    "sensors.md",
    "shaping-a-rail.md",
    "slip-and-flight.md",
    "solvers.md",
    "sweep-overnight.md",
    "sweeps.md",
    "track.md",
    "train.md",
    "training-a-policy.md",
    "uncertainty.md",
)
OF_OTHERS = ("jax.md", "uncertainty.md")
# What 05, 09 and 12 show, tests/equilibrium, tests/simulate/test_own_system.py and tests/classical compute as well.
LONG_EXAMPLES = (
    "03_gradient.py",
    "05_balance.py",
    "06_ode_and_dae.py",
    "08_identification.py",
    "09_own_system.py",
    "10_wobble.py",
    "11_measured_robot.py",
    "12_flipping_ball.py",
)


def by_length(paths, long):
    """README and the first pages for the default run, the ``long`` ones with the slow tests, the others in between."""

    def marks(path):
        if path.name in FIRST_PAGES:
            return ()
        return pytest.mark.slow if path.name in long else pytest.mark.thorough

    return [pytest.param(path, id=path.name, marks=marks(path)) for path in paths]


@pytest.mark.parametrize("document", by_length(DOCUMENTS, LONG_PAGES))
def test_blocks_run_and_print_what_the_page_shows(document, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("XLA_FLAGS", "EQX_ON_ERROR"):
        monkeypatch.setenv(name, os.environ.get(name, ""))
    followed = is_followed(document)
    with as_others_promote() if document.name in OF_OTHERS else contextlib.nullcontext():
        for example in examples_of(document, followed=followed):
            example.evaluate()
    compare_pictures(document, tmp_path, followed=followed)


@contextlib.contextmanager
def as_others_promote():
    """Types and ranks are promoted as JAX does by default, where the code is also that of other libraries."""
    with jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"):
        yield


def is_followed(document: Path) -> bool:
    """Whether a reader types all of it, from the first line to the last."""
    return document.parent.name == "tutorials" or document.name == "start.md"


def compare_pictures(document: Path, made_in: Path, *, followed: bool) -> None:
    """A picture whose name a block writes is what it writes; a page that is followed writes all that it shows."""
    for target in re.findall(r"!\[[^\]]*\]\(([^)]*)\)", document.read_text()):
        shown = document.parent / target
        made = made_in / shown.name
        if not made.exists() and not followed:
            continue
        assert made.exists(), f"{document.name} shows {shown.name}, which nothing in it writes"
        if os.environ.get("JAXBALL_WRITE_FIGURES"):
            shutil.copy(made, shown)
        difference = np.subtract(*(coarse(path) for path in (shown, made)))
        assert np.sqrt(np.mean(difference**2)) < 8.0, f"{shown.name} is another picture"


def test_outputs_agree_up_to_the_digits_that_are_shown():
    assert agrees("steps 12,\n  z = 0.3451, in … s", "steps 12, z = 0.34511 , in 1.2 s".replace(" ,", ","))
    assert agrees("error 2.1e-09", "error 2.15e-09")
    for shown, printed in [("12 rows", "13 rows"), ("0.345", "0.349"), ("ok", "failed"), ("1.5e-9", "1.5e-8")]:
        assert not agrees(shown, printed)


@pytest.mark.parametrize("text", ["θ = 2.0\nθ + 1.0  # 2.0: wrong", "print('two')\n```\n\n```output\nthree"])
def test_a_page_that_shows_something_else_is_found(text, tmp_path):
    page = tmp_path / "page.md"
    page.write_text(f"# Page\n\n```python\n{text}\n```\n")
    with pytest.raises(SybilFailure, match=r"page (says|shows)"):
        [example.evaluate() for example in examples_of(page, followed=False)]


@pytest.mark.parametrize("example", by_length(EXAMPLES, LONG_EXAMPLES))
def test_example_runs(example, tmp_path):
    done = subprocess.run([sys.executable, str(example)], cwd=tmp_path, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert done.stdout


def test_links_between_files_lead_somewhere():
    for document in [
        *DOCUMENTS,
        *(ROOT / name for name in ("CONTRIBUTING.md", "benchmarks/README.md", "tests/README.md")),
    ]:
        for target in re.findall(r"\]\((?!https?:)([^)#]+)", document.read_text()):
            # What the site makes, it checks itself.
            if "/gallery/" in f"/{target}" or "/python/" in f"/{target}" or target.endswith("command-line.md"):
                continue
            assert (document.parent / target).exists(), f"{document.name} links to {target}"


def test_commands_of_the_readme(tmp_path, monkeypatch):
    """The console lines of the section on the command line, one after the other; those of ``start.md`` are typed."""
    section = (ROOT / "README.md").read_text().split("## On the command line")[1]
    lines = section.split("```console\n")[1].split("```")[0].splitlines()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XLA_FLAGS", os.environ.get("XLA_FLAGS", ""))
    for line in lines:
        program, *words = shlex.split(line, comments=True)
        assert program == "jaxball"
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            assert main(words[: words.index(">")] if ">" in words else words) == 0, line
        if ">" in words:
            Path(words[-1]).write_text(printed.getvalue())
    assert Path("run.nc").stat().st_size > 0
    assert list(Path("figures").glob("*.png"))


def rooms() -> dict[str, Path]:
    """The entries of ``src/jaxball`` as the maps write them, each with the file whose docstring says what it is."""
    entries = {path for path in (ROOT / "src" / "jaxball").iterdir() if not path.name.startswith("__")}
    folders = {f"{path.name}/": path / "__init__.py" for path in entries if path.is_dir()}
    return folders | {path.name: path for path in entries if path.suffix == ".py"}


def test_the_map_is_the_folder_from_the_bottom_up():
    section = (ROOT / "CONTRIBUTING.md").read_text().split("## The map")[1].split("\n## ")[0]
    names = re.findall(r"^\| `([\w/.]+)` \|", section, flags=re.MULTILINE)
    assert sorted(names) == sorted(rooms())
    contract = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"][0]
    floor = {name: -k for k, layer in enumerate(contract["layers"]) for name in re.findall(r"\w+", layer)}
    floors = [floor[name.split(".")[0].strip("/")] for name in names]
    assert floors == sorted(floors)


def test_each_room_says_what_lives_there():
    for name, file in rooms().items():
        assert ast.get_docstring(ast.parse(file.read_text())), name


def test_every_folder_of_tests_says_what_it_compares_with():
    table = (ROOT / "tests" / "README.md").read_text().split("## What each folder compares with")[1].split("\n## ")[0]
    folders = {path.name for path in (ROOT / "tests").iterdir() if (path / "__init__.py").exists()}
    said = [
        name for row in re.findall(r"^\| (`.*?) \|", table, flags=re.MULTILINE) for name in re.findall(r"`(\w+)`", row)
    ]
    assert sorted(said) == sorted(folders - {"support"})


def test_the_page_on_files_has_every_status():
    table = (ROOT / "docs" / "reference" / "files.md").read_text()
    rows = re.findall(r"^\| (\d+) \| `([A-Z_]+)` \|", table, flags=re.MULTILINE)
    assert rows == [(str(int(status)), status.name) for status in Status]


def test_the_page_on_verification_states_every_law_as_the_command_does():
    table = (ROOT / "docs" / "how-to" / "verify.md").read_text().split("\n## The laws\n")[1].split("\n## ")[0]
    rows = re.findall(r"^\| `([\w-]+)` \| (.*?) \| [^|]+ \|$", table.replace("\\|", "¦"), flags=re.MULTILINE)
    stated = {name: law.replace("¦", "|") for name, law in rows}
    assert list(stated) == list(LAWS)
    assert [name for name, law in LAWS.items() if not stated[name].startswith(law)] == []


def test_the_page_on_sweeps_names_every_option_of_their_figures():
    (commands,) = (one for one in parser_of(["sweep"])._actions if isinstance(one, argparse._SubParsersAction))
    options = re.findall(r"--[\w-]+", commands.choices["sweep"].usage.split("sweep plot")[1])
    section = (ROOT / "docs" / "how-to" / "sweeps.md").read_text().split("\n## Figures\n")[1]
    assert {"--out", "--force"} <= set(options)
    assert [option for option in options if not re.search(rf"{option}(?![\w-])", section)] == []


def test_the_page_on_views_names_every_arrow():
    arrows = (ROOT / "src" / "jaxball" / "plot" / "view" / "source" / "arrows.js").read_text()
    named = arrows.split("get named() {")[1].split("filter(")[0]
    symbols = re.findall(r'"([^"]*)", (?:\w+|"ink")[\],]', named)
    page = (ROOT / "docs" / "how-to" / "view.md").read_text()
    assert {"N", "f", "vₛ", "N + f"} <= set(symbols)
    assert [symbol for symbol in symbols if not re.search(rf"(?<!\w){re.escape(symbol)}(?!\w)", page)] == []
