"""A signal ends a command with one sentence and its exit code, 130 for Ctrl-C, whatever the command is doing."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

# Of a process that hears Ctrl-C as a command does, and presses it.
PRELUDE = """
import os, signal, sys, time
from pathlib import Path
from jaxball.interface import interruption
from jaxball.interface.output import replacing

interruption.end_at_signals()
press = lambda: (os.kill(os.getpid(), signal.SIGINT), time.sleep(60))
"""

MOMENTS = {
    "while the main thread is in a call of C": ("press()", "Stopped."),
    "where an exception would be lost": (
        """
class Loses:
    def __del__(self):
        os.kill(os.getpid(), signal.SIGINT)
        for _ in range(10**9): pass
Loses()
time.sleep(60)
""",
        "Stopped.",
    ),
    "while a file is written": (
        """
with replacing(Path("run.csv")) as beside:
    beside.write_text("half of it")
    press()
""",
        "Stopped.",
    ),
    "where there is something to be said": (
        'with interruption.interrupt_message(lambda: "Stopped; all is well."):\n    press()',
        "Stopped; all is well.",
    ),
    "after it was pressed already": (
        'with interruption.stop_requested("Stopping.") as stop:\n'
        "    os.kill(os.getpid(), signal.SIGINT)\n    assert stop.wait(60)\n    press()",
        "Stopping.\njaxball: Stopped.",
    ),
}


@pytest.fixture(autouse=True)
def hears_ctrl_c():
    """Children of a process that ignores Ctrl-C, as in the background of a shell, would ignore it too."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def start(program, *arguments, folder):
    """A process of its own, in a session of its own as in a terminal of its own."""
    return subprocess.Popen(
        [sys.executable, *program, *arguments],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


@pytest.mark.parametrize(("program", "words"), MOMENTS.values(), ids=MOMENTS.keys())
def test_ctrl_c(tmp_path, program, words):
    (tmp_path / "run.csv").write_text("precious")
    with start(["-c", PRELUDE + program], folder=tmp_path) as run:
        output, errors = run.communicate(timeout=50)
    assert (run.returncode, output, errors) == (130, "", f"jaxball: {words}\n")
    assert [path.name for path in tmp_path.iterdir()] == ["run.csv"]
    assert (tmp_path / "run.csv").read_text() == "precious"


WHILE_A_FILE_IS_WRITTEN, _ = MOMENTS["while a file is written"]
WHEN_IT_WAS_GIVEN_ALREADY = """
with interruption.stop_requested("Stopping; {again}.") as stop:
    os.kill(os.getpid(), signal.SIGINT)
    assert stop.wait(60)
    press()
"""


@pytest.mark.parametrize("name", ["SIGTERM", "SIGHUP"])
def test_other_signals(tmp_path, name):
    if not hasattr(signal, name):
        pytest.skip("this system does not have the signal")
    (tmp_path / "run.csv").write_text("precious")
    ends = {
        WHILE_A_FILE_IS_WRITTEN: "jaxball: Stopped.\n",
        WHEN_IT_WAS_GIVEN_ALREADY: f"jaxball: Stopping; send {name} again.\njaxball: Stopped.\n",
    }
    for program, said in ends.items():
        default = f"import signal; signal.signal(signal.{name}, signal.SIG_DFL)"  # nohup has it ignored
        with start(["-c", default + (PRELUDE + program).replace("SIGINT", name)], folder=tmp_path) as run:
            output, errors = run.communicate(timeout=50)
        assert (run.returncode, output, errors) == (128 + getattr(signal, name), "", said)
    assert [path.name for path in tmp_path.iterdir()] == ["run.csv"]
    assert (tmp_path / "run.csv").read_text() == "precious"


def test_ctrl_c_is_ignored_where_a_shell_says_so(tmp_path):
    program = "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)" + PRELUDE
    with start(["-c", program + "os.kill(os.getpid(), signal.SIGINT); print('done')"], folder=tmp_path) as run:
        assert run.communicate(timeout=50) == ("done\n", "")
    assert run.returncode == 0


# What Python runs before the command: Ctrl-C when a module is first looked for.
PRESS_AT = """
import os, signal, sys

class PressAt:
    def find_spec(name, path=None, target=None):
        if name == os.environ["PRESS_AT"]:
            signal.signal(signal.SIGINT, signal.default_int_handler)  # a background job has it ignored
            os.kill(os.getpid(), signal.SIGINT)

sys.meta_path.insert(0, PressAt)
"""


@pytest.mark.parametrize(
    "module", ["jaxball.interface.names", "jaxball.cli", "jaxball.interface.interruption", "threading"]
)
@pytest.mark.parametrize("as_module", [True, False], ids=["python -m jaxball", "jaxball"])
def test_ctrl_c_while_the_command_is_imported(tmp_path, monkeypatch, module, as_module):
    (tmp_path / "sitecustomize.py").write_text(PRESS_AT)
    script = tmp_path / "jaxball"  # as pip writes it
    script.write_text("import sys\nfrom jaxball.cli import main\nsys.exit(main())")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")]))
    monkeypatch.setenv("PRESS_AT", module)
    with start(["-m", "jaxball"] if as_module else [str(script)], "scenarios", folder=tmp_path) as run:
        output, errors = run.communicate(timeout=50)
    assert (run.returncode, output, errors) == (130, "", "jaxball: Stopped.\n")


@pytest.mark.slow
def test_ctrl_c_at_random_moments():
    """Twice in each command; ``python -m tests.cli.interrupted 200 1`` presses it oftener."""
    command = [sys.executable, "-m", "tests.cli.interrupted", "24", "1"]
    done = subprocess.run(command, cwd=Path(__file__).parents[2], capture_output=True, text=True, timeout=1500)
    assert done.returncode == 0, done.stderr
    assert "bad: " not in done.stdout, done.stdout


@pytest.mark.skipif(not Path("/proc/self/maps").exists(), reason="this system does not show what a process has loaded")
def test_ctrl_c_while_jax_is_imported(tmp_path):
    with start(["-m", "jaxball"], "simulate", "ball", folder=tmp_path) as run:
        deadline = time.monotonic() + 50
        while "libjax_common" not in Path(f"/proc/{run.pid}/maps").read_text():
            assert run.poll() is None
            assert time.monotonic() < deadline
        os.killpg(run.pid, signal.SIGINT)
        output, errors = run.communicate(timeout=50)
    assert (run.returncode, output, errors) == (130, "", "jaxball: Stopped.\n")
