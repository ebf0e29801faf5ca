"""MuJoCo: the robot as MJCF, stepped with ``mj_step``."""

import contextlib
import importlib
import time
from collections.abc import Iterator
from typing import Any

import numpy as np

from jaxball.files.mjcf import to_mjcf
from jaxball.files.mjcf.writing import Exported
from jaxball.physics.body import Disk
from jaxball.physics.state import DiskState

from .contract import Case, Motion, Row, Setting, motion_of

# Untyped, because it need not be installed where types are checked.
mujoco: Any = importlib.import_module("mujoco")
INTEGRATORS = {
    name: getattr(mujoco.mjtIntegrator, f"mjINT_{name.upper()}") for name in ("Euler", "implicitfast", "RK4")
}


def run(case: Case, setting: Setting, timestep: float) -> Motion:
    """The motion of a robot; raises :class:`~jaxball.files.mjcf.MJCFError` where MJCF cannot express it."""
    scenario = case.scenario()
    steps = np.rint(np.diff(scenario.times) / timestep).astype(int)
    timestep = float(np.diff(scenario.times)[0] / steps[0])  # of which the save times are multiples
    exported = to_mjcf(scenario, timestep=timestep)
    model = model_of(case, setting, exported, timestep)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    rows, seconds = [_row(data, scenario)], 0.0
    with _set_controls(exported, scenario.times[0], timestep, int(steps.sum())):
        for count in steps:
            begin = time.process_time()
            mujoco.mj_step(model, data, int(count))
            seconds += time.process_time() - begin
            rows.append(_row(data, scenario))
    return motion_of(rows, seconds, int(steps.sum()))


def model_of(case: Case, setting: Setting, exported: Exported, timestep: float) -> Any:
    """The model of a robot with a setting and a time step."""
    model = mujoco.MjModel.from_xml_string(exported.text)
    _set(model, setting.values, timestep)
    if not case.scenario().may_slip:
        model.geom_friction[:, 0] = case.friction
    return model


def final_place(model: Any, controls: np.ndarray) -> np.ndarray:
    """Where the shell is after as many steps as there are ``controls``, each kept within its step."""
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    for control in controls:
        data.ctrl[:] = control
        mujoco.mj_step(model, data)
    return data.joint("shell").qpos[:2].copy()


@contextlib.contextmanager
def _set_controls(exported: Exported, start: float, timestep: float, steps: int) -> Iterator[None]:
    """Sets controls at the time of each evaluation, for a Runge–Kutta method also the middle of the step."""
    if not exported.controls:
        yield
        return
    controls = exported.controls_at(start + timestep / 2 * np.arange(2 * steps + 3))

    def control(model: Any, data: Any) -> None:
        data.ctrl[:] = controls[round(2 * (data.time - start) / timestep)]

    mujoco.set_mjcb_control(control)
    try:
        yield
    finally:
        mujoco.set_mjcb_control(None)


def _set(model: Any, values: Any, timestep: float) -> None:
    """Changes the options of a model, and the springs of its contacts."""
    option = model.opt
    option.timestep = timestep
    option.integrator = INTEGRATORS[values.get("integrator", "Euler")]
    pyramidal = values.get("cone", "pyramidal") == "pyramidal"
    option.cone = mujoco.mjtCone.mjCONE_PYRAMIDAL if pyramidal else mujoco.mjtCone.mjCONE_ELLIPTIC
    option.impratio = values.get("impratio", 1.0)
    option.noslip_iterations = values.get("noslip_iterations", 0)
    option.tolerance = values.get("tolerance", 1e-8)
    option.iterations = values.get("iterations", 100)
    if "condim" in values:
        model.geom_condim[:] = values["condim"]
        model.geom_friction[:, 1:] = 0.0
    steps = values.get("solref steps")  # the time constant in steps
    if steps is not None:
        model.geom_solref[:] = (steps * timestep, 1.0)
    if "solimp" in values:
        model.geom_solimp[:] = values["solimp"]


def _row(data: Any, scenario: Any) -> Row:
    names = scenario.system.coordinates
    theta = np.array([data.joint(name).qpos[0] for name in names])
    thetadot = np.array([data.joint(name).qvel[0] for name in names])
    r = float(scenario.system.radius)
    if isinstance(scenario.system, Disk):
        x, rise, phi = (data.joint(name).qpos[0] for name in ("x", "z", "phi"))
        vx, vz, phidot = (data.joint(name).qvel[0] for name in ("x", "z", "phi"))
        in_space = DiskState(phi=phi, phidot=phidot, z=x).in_space()
        centre, V = np.array([x, 0.0, r + rise]), np.array([vx, 0.0, vz])
        return np.asarray(in_space.q), np.asarray(in_space.Omega), centre, V, theta, thetadot
    shell = data.joint("shell")
    qpos, qvel = shell.qpos.copy(), shell.qvel.copy()
    return qpos[3:], qvel[3:], qpos[:3], qvel[:3], theta, thetadot
