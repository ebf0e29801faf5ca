"""The settings of XLA's CPU backend: set once, beside the user's own, and only where they are accepted."""

import os

import jaxlib.version
import pytest

from jaxball.programs import cpu
from tests.support.scripts import printed_by


@pytest.fixture
def flags(monkeypatch):
    """The environment, restored afterwards."""
    monkeypatch.delenv("XLA_FLAGS", raising=False)
    monkeypatch.setattr("importlib.metadata.version", lambda name: "0.12.0.1")
    return monkeypatch


def test_twice_is_once(flags):
    """And multi-output fusion is not used: with it, a wrong derivative was seen in reverse mode."""
    assert cpu.prepare()
    assert cpu.prepare()
    assert os.environ["XLA_FLAGS"].split() == list(cpu.FLAGS)
    assert "multi_output" not in os.environ["XLA_FLAGS"]


@pytest.mark.parametrize(
    ("own", "added"),
    [
        ("--xla_dump_to=/nowhere", cpu.FLAGS),
        ("--xla_cpu_prefer_vector_width=256", cpu.FLAGS[:1]),
        ("--xla_backend_extra_options=xla_cpu_use_multi_output_fusion=false", ()),
    ],
)
def test_flags_of_the_user_stay(flags, own, added):
    flags.setenv("XLA_FLAGS", own)
    assert cpu.prepare() == bool(added)
    assert os.environ["XLA_FLAGS"].split() == [own, *added]


@pytest.mark.parametrize(
    ("version", "older"), [("0.10.0", True), ("0.10.1", True), ("0.11.2", False), ("0.12.0.1", False)]
)
def test_known_versions_are_not_probed(flags, version, older):
    flags.setattr("importlib.metadata.version", lambda name: version)
    flags.setattr(cpu, "_accepts", lambda flags: pytest.fail("probed"))
    assert cpu.prepare()
    assert (cpu.OLDER in os.environ["XLA_FLAGS"].split()) is older


@pytest.mark.parametrize("version", ["0.9.2", "0.13.0", "1.0"])
@pytest.mark.parametrize("accepted", [True, False])
def test_other_versions_are_probed(flags, version, accepted):
    flags.setattr("importlib.metadata.version", lambda name: version)
    flags.setattr(cpu, "_accepts", lambda flags: accepted)
    assert cpu.prepare() is accepted
    assert ("XLA_FLAGS" in os.environ) is accepted


@pytest.mark.thorough
def test_the_installed_version_accepts_its_flags():
    assert cpu._accepts(" ".join(cpu.flags_of(jaxlib.version.__version_info__)))


def test_the_probe_finds_what_is_not_accepted():
    assert not cpu._accepts("--xla_no_such_flag=1")


@pytest.mark.thorough
def test_programs_run_in_the_thread_that_calls_them():
    program = """if True:
        from jaxball.programs import cpu
        cpu.prepare()
        import jax
        print(jax.config.read("jax_cpu_enable_async_dispatch"))
    """
    assert printed_by("-c", program) == "False\n"


FORWARD_MODE = """
from jaxball.programs import cpu
assert cpu.prepare()
import jax, numpy as np
jax.config.update("jax_enable_x64", True)
from jaxball import DiskState, paper
from jaxball.simulation.ensemble import simulate_ensemble
rows = lambda tree: jax.tree.map(lambda leaf: np.stack([np.asarray(leaf)] * 2), tree)
leaves, tree = jax.tree.flatten(rows(paper.disk()))
def end(scale):
    disks = tree.unflatten([leaves[0] * scale, *leaves[1:]])
    return simulate_ensemble(disks, (0.0, 1.0), rows(DiskState()), rtol=1e-9, atol=1e-9).trajectory.state.z[:, -1]
slope = jax.jvp(end, (1.0,), (1.0,))[1]
across = (end(1.0 + 1e-4) - end(1.0 - 1e-4)) / 2e-4
assert np.all(slope != 0)
np.testing.assert_allclose(slope, across, rtol=1e-6)
"""


@pytest.mark.long
def test_derivatives_of_ensembles_in_forward_mode():
    """With other settings, XLA was seen to stop the process."""
    printed_by("-c", FORWARD_MODE, env={name: value for name, value in os.environ.items() if name != "XLA_FLAGS"})


def test_import_sets_nothing():
    program = "import os, jaxball, jaxball.programs.cpu; print(os.environ.get('XLA_FLAGS'))"
    environment = {name: value for name, value in os.environ.items() if name != "XLA_FLAGS"}
    assert printed_by("-c", program, env=environment) == "None\n"
