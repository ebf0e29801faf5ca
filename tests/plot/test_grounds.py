"""The ground in animations: gravity points down, slopes slope, and planes and turntables move."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jaxball
from jaxball import BallState, ConstantRate, Ground, HarmonicSeries, Oscillating, Turntable
from jaxball.plot.record import record
from jaxball.plot.scene import scene
from tests.plot.geometry import overlaps

ANGLE, HEADING, RATE, CENTRE = 0.4, 2.5, 1.5, np.array([1.0, 0.5])
TIMES = np.linspace(0.0, 4.0, 21)


@pytest.fixture(scope="module")
def ball_on_a_ground():
    """A ball on a tilted turntable that is shaken."""
    shaken = Oscillating(HarmonicSeries((0.0, 0.0, 0.0), [(0.5, 0.0, 0.2)], [2.0]))
    ground = Ground(ANGLE, HEADING, shaken, turntable=Turntable(ConstantRate(0.2, rate=RATE), CENTRE))
    ball = jaxball.Ball(mass=1.0, inertia=(0.4, 0.4, 0.4), offset=(0.0, 0.0, -0.2), gravity=0.5, ground=ground)
    return jaxball.simulate(ball, TIMES, BallState(Omega=(0.3, 0.0, 0.0)), rtol=1e-6, atol=1e-6)


@pytest.fixture(scope="module")
def disk_on_a_slope():
    disk = jaxball.Disk(mass=1.0, inertia=0.5, ground=Ground(ANGLE))
    return jaxball.simulate(disk, TIMES, jaxball.DiskState(), rtol=1e-6, atol=1e-6)


def lines(figure, **look):
    """The points of the lines that look so."""
    shown = [line for line in figure.axes[0].lines if all(getattr(line, f"get_{k}")() == v for k, v in look.items())]
    return [np.column_stack(line.get_data_3d() if hasattr(line, "get_data_3d") else line.get_data()) for line in shown]


@pytest.mark.thorough
def test_gravity_points_down_on_the_page_and_the_ground_moves(ball_on_a_ground):
    """The page is the plane turned about its level line by the tilt, after its displacement."""
    page = Rotation.from_rotvec(ANGLE * np.array([-np.sin(HEADING), np.cos(HEADING), 0.0]))
    gravity = [np.sin(ANGLE) * np.cos(HEADING), np.sin(ANGLE) * np.sin(HEADING), -np.cos(ANGLE)]
    np.testing.assert_allclose(page.apply(gravity), [0.0, 0.0, -1.0], atol=1e-12)
    run = record(ball_on_a_ground)
    figure, show = scene(ball_on_a_ground, run)
    for k in (0, 7, 20):
        show(k)
        t, moved = TIMES[k], np.array([0.5, 0.0, 0.2]) * np.sin(2 * TIMES[k])
        (trail,) = lines(figure, linewidth=1.8)
        (star,) = lines(figure, marker="*")
        (spoke,) = lines(figure, linewidth=1.4)
        contact = np.asarray([*ball_on_a_ground.state.z[k], -1.0])
        np.testing.assert_allclose(trail[-1], page.apply(contact + moved), atol=1e-12)
        np.testing.assert_allclose(
            star[0], page.apply(contact + [0, 0, 1] + moved + run.observables.centre_of_mass_space[k]), atol=1e-12
        )
        np.testing.assert_allclose(spoke[0], page.apply(np.array([*CENTRE, -1.0]) + moved), atol=1e-12)
        outward = page.inv().apply(spoke[1] - spoke[0])
        np.testing.assert_allclose(outward[2], 0.0, atol=1e-12)
        turned = np.exp(1j * (0.2 + RATE * t))
        np.testing.assert_allclose((outward[0] + 1j * outward[1]) / np.linalg.norm(outward), turned, atol=1e-12)


@pytest.mark.thorough
def test_the_trail_of_a_disk_falls_with_the_slope(disk_on_a_slope):
    figure, show = scene(disk_on_a_slope, record(disk_on_a_slope))
    show(20)
    (trail,) = lines(figure, linewidth=3.0)
    distance = float(disk_on_a_slope.state.z[20])
    assert distance > 1
    np.testing.assert_allclose(trail[-1] - trail[0], distance * np.array([np.cos(ANGLE), -np.sin(ANGLE)]), atol=1e-12)


@pytest.mark.thorough
@pytest.mark.parametrize("run", ["ball_on_a_ground", "disk_on_a_slope"])
def test_the_texts_of_a_scene_with_a_ground_are_apart(run, request):
    figure, show = scene(request.getfixturevalue(run), record(request.getfixturevalue(run)))
    for k in (0, 20):
        show(k)
        assert overlaps(figure) == []


@pytest.mark.thorough
def test_the_velocity_over_a_plane_that_vibrates_is_relative_to_it():
    """V is that of rolling, rω × e3, along a plane that moves but does not turn."""
    shaken = Oscillating(HarmonicSeries((0.0, 0.0, 0.0), [(0.5, 0.0, 0.0)], [2.0]))
    disk = jaxball.Disk(mass=1.0, inertia=0.5, offset=(0.0, 0.0, -0.3), ground=Ground(0.0, motion=shaken))
    run = jaxball.simulate(disk, TIMES, jaxball.DiskState(), rtol=1e-6, atol=1e-6)
    drawn = run.plot("centre_velocity").lines[0].get_ydata()
    assert np.ptp(drawn) > 0.1
    np.testing.assert_allclose(drawn, -np.asarray(run.state.phidot), atol=1e-12)
