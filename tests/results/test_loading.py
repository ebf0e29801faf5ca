"""Saved runs are read back with the bits of their states, and what is no run is refused in a sentence."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from matplotlib.figure import Figure

import jaxball
from jaxball import ScenarioError, load_run, load_scenario, read_scenario, simulate
from jaxball.files.results import OutputError, saved_scenario
from jaxball.files.results.files import CHECKSUM, RunError
from jaxball.plot import report
from tests.results.same import assert_same
from tests.scenario.documents import BALL, DISK
from tests.support.sentences import refuses

INTEGRATED = BALL + '[actuation]\nform = "integrated"\n'


def assert_same_run(run, trajectory):
    assert run.message == trajectory.message
    assert (run.ok, int(run.steps), int(run.rejected)) == (
        trajectory.ok,
        int(trajectory.steps),
        int(trajectory.rejected),
    )
    assert_same((run.state, run.system), (trajectory.state, trajectory.system))
    np.testing.assert_array_equal(run.times, trajectory.times)


@pytest.fixture(scope="module")
def ball():
    scenario = read_scenario(INTEGRATED)
    return scenario, scenario.simulate()


@pytest.mark.thorough
@pytest.mark.parametrize("suffix", [".nc", ".npz"])
def test_a_ball_with_a_driven_mass(ball, tmp_path, suffix):
    scenario, trajectory = ball
    run = load_run(jaxball.save(trajectory, tmp_path / f"run{suffix}", scenario))
    assert_same_run(run, trajectory)
    np.testing.assert_array_equal(run.observables.normal_force, trajectory.observables.normal_force)
    assert str(run) == str(trajectory)


@pytest.mark.thorough
@pytest.mark.parametrize("suffix", [".nc", ".npz"])
def test_a_failed_run_comes_back_as_failed(ball, tmp_path, suffix):
    scenario, _ = ball
    trajectory = scenario.simulate(max_steps=4)
    run = load_run(jaxball.save(trajectory, tmp_path / f"run{suffix}", scenario))
    assert not run.ok
    assert "max_steps" in run.message
    assert_same_run(run, trajectory)
    assert np.isnan(run.state.z[-1]).all()


def test_a_classical_system_and_its_laws(tmp_path):
    scenario = load_scenario("vakonomic-particle")
    trajectory = scenario.simulate()
    run = load_run(jaxball.save(trajectory, tmp_path / "run.nc", scenario))
    assert_same_run(run, trajectory)
    np.testing.assert_array_equal(run.laws.energy, trajectory.laws.energy)
    assert isinstance(run.plot(), Figure)


@pytest.mark.thorough
def test_the_scenario_of_a_run_can_be_simulated_again(ball, tmp_path):
    scenario, trajectory = ball
    path = jaxball.save(trajectory, tmp_path / "run.npz", scenario)
    again = saved_scenario(path).simulate()
    np.testing.assert_array_equal(again.state.z, trajectory.state.z)


@pytest.mark.thorough
def test_a_trajectory_saves_itself_with_its_system(tmp_path):
    """Its file says the system, the initial state and the times, and that nothing is known of the solver."""
    scenario = read_scenario(DISK)
    trajectory = simulate(scenario.system, scenario.times, scenario.state, rtol=1e-8, atol=1e-8)
    path = trajectory.save(tmp_path / "run.nc")
    assert_same_run(load_run(path), trajectory)
    text = trajectory.to_dataset().attrs["scenario"]
    assert "does not contain its solver settings" in text
    assert "[solve]" not in read_scenario(text).title + text.split("\n", 1)[1]
    with refuses(OutputError, "path", "run.xlsx"):
        trajectory.save(tmp_path / "run.xlsx")


@pytest.mark.thorough
@pytest.mark.parametrize("suffix", [".nc", ".npz"])
def test_a_run_of_a_scenario_saves_its_title_and_settings(tmp_path, suffix):
    """Those of the call in the place of the scenario's; a run that was read back has them, and saves them again."""
    settings = '\n[solve]\nsolver = "tsit5"\nmax_steps = 999\nstep_to_times = true\n'
    scenario = read_scenario('title = "A disk"\n' + DISK + settings)
    run = scenario.simulate(rtol=1e-7, atol=1e-9)
    path = run.save(tmp_path / f"run{suffix}")
    for saved in (path, load_run(path).save(tmp_path / f"again{suffix}")):
        again = saved_scenario(saved)
        assert (again.title, again.solver, again.max_steps) == ("A disk", "tsit5", 999)
        assert (again.rtol, again.atol, again.step_to_times) == (1e-7, 1e-9, True)
        np.testing.assert_array_equal(again.simulate().state.z, run.state.z)
    assert run.to_dataset().attrs["title"] == "A disk"
    assert "A disk" in run.view().html


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("scenario", "named"), [("ball", "scenario"), (read_scenario(DISK.replace("mass = 1.0", "mass = 3.0")), "mass")]
)
def test_a_run_is_not_saved_with_the_scenario_of_another_system(no_type_checks, tmp_path, scenario, named):
    """What was read again was a run of that system, or none at all."""
    run = read_scenario(DISK).simulate()
    for other in (scenario, load_scenario("ball")):
        with refuses((TypeError, ValueError), named if other is scenario else "scenario"):
            jaxball.save(run, tmp_path / "run.npz", other)
    assert not any(tmp_path.iterdir())


def test_what_a_transformation_returns_has_no_scenario():
    run = read_scenario(DISK).simulate()
    assert run.scenario is not None
    assert jax.tree.map(lambda leaf: 2 * leaf, run).scenario is None


@pytest.mark.thorough
def test_a_file_without_a_scenario_needs_the_system(tmp_path):
    def helix(theta, parameters):
        return 0.5 * jnp.stack([jnp.cos(theta), jnp.sin(theta), 0.1 * theta])

    motion = jaxball.OnRail(jaxball.FunctionRail(helix), jaxball.Pulse(0.0))
    ball = jaxball.Ball(mass=1.0, inertia=(0.9, 1.0, 1.1), masses=[jaxball.PointMass(0.2, motion)])
    trajectory = simulate(ball, np.linspace(0.0, 0.1, 3), jaxball.physics.ReducedState(Omega=[0.1, 0.2, 0.3]))
    scenario = jaxball.Scenario("A helix", ball, trajectory.start, np.asarray(trajectory.times))
    assert trajectory.set_scenario(scenario).to_dataset().attrs["title"] == "A helix"
    path = trajectory.save(tmp_path / "run.nc")
    with refuses(RunError, "load_run"):
        load_run(path)
    assert_same_run(load_run(path, ball), trajectory)


@pytest.mark.long
def test_a_run_is_drawn_as_the_trajectory_was(disk_trajectory, tmp_path):
    run = load_run(disk_trajectory.save(tmp_path / "run.nc"))
    pictures = [one.save_figures(tmp_path / name) for name, one in (("new", run), ("old", disk_trajectory))]
    for again, before in zip(*pictures, strict=True):
        assert again.read_bytes() == before.read_bytes()
    assert len(run.plot().axes) == 6


@pytest.mark.thorough
def test_figures_in_other_formats(disk_trajectory, tmp_path, monkeypatch):
    monkeypatch.setattr(report, "STANDARD", report.STANDARD[:2])
    paths = disk_trajectory.save_figures(tmp_path, formats=("pdf", "svg"))
    assert [path.suffix for path in paths] == [".pdf", ".svg"] * 2
    assert paths[0].read_bytes().startswith(b"%PDF")
    assert b"<svg" in paths[1].read_bytes()


@pytest.mark.thorough
def test_sentences(ball, tmp_path):
    scenario, trajectory = ball
    good = jaxball.save(trajectory, tmp_path / "run.npz", scenario)
    with np.load(good) as data:
        content = {name: data[name] for name in data.files if name != CHECKSUM}  # as another program writes it

    def changed(name, **changes):
        np.savez(tmp_path / name, **{key: value for key, value in (content | changes).items() if value is not None})

    changed("newer.npz", format=2, jaxball_version="9.1")
    changed("arrays.npz", format=None)
    changed("other.npz", format="mine")
    changed("stateless.npz", q=None)
    changed("ended.npz", status="TIRED")
    changed("stepless.npz", steps="many")
    changed("unended.npz", reached=None)
    changed("slippery.npz", contact_friction="ice")
    changed("garbled.npz", scenario=str(content["scenario"]).replace("radius", "radios"))
    (tmp_path / "text.nc").write_text("not a data set")
    (tmp_path / "text.npz").write_text("not an archive")
    (tmp_path / "folder.nc").mkdir()
    cases = {
        "none.nc": "none.nc",
        "folder.nc": "folder.nc",
        "run.csv": "run.csv",
        "run.txt": "run.txt",
        "text.nc": "text.nc",
        "text.npz": "text.npz",
        "arrays.npz": "format",
        "other.npz": "format",
        "stateless.npz": "stateless.npz",
        "ended.npz": "status",
        "stepless.npz": "steps",
        "unended.npz": "reached",
        "slippery.npz": "contact_friction",
        "newer.npz": "9.1",
        "garbled.npz": "garbled.npz",
    }
    for name, named in cases.items():
        with refuses(RunError, name, named):
            load_run(tmp_path / name)


def test_a_batch_is_saved_run_by_run(tmp_path):
    start = jaxball.DiskState(phidot=-1.0)
    times = np.array([0.0, 1.0])
    runs = jax.vmap(lambda mass: simulate(jaxball.Disk(mass=mass, inertia=0.5), times, start))(jnp.array([1.0, 2.0]))
    with refuses(ValueError, "A file"):
        runs.save(tmp_path / "runs.npz")
    path = jax.tree.map(lambda leaf: leaf[1], runs).save(tmp_path / "run.npz")
    np.testing.assert_allclose(load_run(path).state.z, times, atol=1e-9)


def test_a_saved_run_is_not_a_scenario_file(tmp_path):
    path = simulate(jaxball.Disk(mass=1.0, inertia=0.5), np.array([0.0, 1.0])).save(tmp_path / "run.npz")
    with refuses(ScenarioError, "source"):
        load_scenario(path)


@pytest.mark.usefixtures("no_type_checks")
def test_a_scenario_is_named_by_its_path():
    with refuses(TypeError, "source"):
        load_scenario(3)
