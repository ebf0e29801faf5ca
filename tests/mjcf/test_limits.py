"""The limits of actuators of a file: the forces of saturated motors are those of MuJoCo."""

import tomllib

import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

from jaxball import write_scenario
from jaxball.cli import main
from jaxball.files.mjcf import read_mjcf
from jaxball.files.scenario import read_document
from jaxball.files.scenario.paths import numbers_of, with_numbers

ROBOT = """
<mujoco>
  <option timestep="0.0005" integrator="RK4"/>
  <worldbody>
    <geom type="plane" size="1 1 0.1"/>
    <body pos="0 0 20">
      <freejoint/>
      <geom size="0.2" mass="2"/>
      <body pos="0.05 0 0">
        <joint name="swing" axis="0 1 0"/>
        <geom type="capsule" size="0.02 0.05" pos="0 0 -0.08" mass="0.5" contype="0" conaffinity="0"/>
      </body>
    </body>
  </worldbody>
  <actuator>{}</actuator>
</mujoco>
"""
ASKED = 7.0  # the control, which is beyond every range here
CASES = {
    "a control": '<motor joint="swing" gear="0.5" ctrlrange="-0.4 0.4"/>',
    "a force": '<motor joint="swing" gear="-0.5" forcerange="-0.3 0.3"/>',
    "both": '<motor joint="swing" gear="2" ctrlrange="-0.2 0.2" forcerange="-0.3 0.3"/>',
    "a gain": '<general joint="swing" gainprm="3" ctrlrange="-0.1 0.1"/>',
    "a gain and a force": '<general joint="swing" gainprm="3" ctrlrange="-1 1" forcerange="-0.25 0.25"/>',
    "none": '<motor joint="swing" gear="0.02" ctrllimited="false" ctrlrange="-1 1"/>',
}


def _of_mujoco(actuator):
    model = mujoco.MjModel.from_xml_string(ROBOT.format(actuator))
    data = mujoco.MjData(model)
    data.ctrl[:] = ASKED
    mujoco.mj_forward(model, data)
    return model, data


def _asked(actuator):
    """The scenario with the signal that the control asks for in MuJoCo, whatever its limit."""
    scenario = read_mjcf(ROBOT.format(actuator), contact=True).scenario
    model = mujoco.MjModel.from_xml_string(ROBOT.format(actuator))
    signal = ASKED * model.actuator_gear[0, 0] * model.actuator_gainprm[0, 0]
    document = tomllib.loads(write_scenario(scenario))
    (path,) = (path for path in numbers_of(document) if path.endswith(".signal"))
    return read_document(with_numbers(document, {path: signal}))


@pytest.mark.thorough
@pytest.mark.parametrize("actuator", CASES.values(), ids=CASES)
def test_a_saturated_motor_has_the_force_of_mujoco(actuator):
    _, data = _of_mujoco(actuator)
    motor = _asked(actuator).system.mechanisms[0].drives[0]
    torque = motor(*map(jnp.asarray, (0.0, 0.0, 0.0)), None)
    np.testing.assert_allclose(float(torque), data.qfrc_actuator[6], rtol=1e-14)


def test_what_is_set_to_zero_or_left_out_is_told(tmp_path, capsys):
    robot = tmp_path / "robot.xml"
    servo = '<position name="aim" joint="swing" kp="2" ctrlrange="-1 1"/>'
    one_way = '<motor name="push" joint="swing" ctrlrange="0 1"/>'
    robot.write_text(ROBOT.format(servo + one_way).replace('name="swing" ', 'name="swing" actuatorfrcrange="-1 1" '))
    assert main(["import", str(robot), "--out", str(tmp_path / "robot.toml")]) == 0
    lines = capsys.readouterr().out.splitlines()
    zero, joint, aim, push, _ = lines
    assert zero == (
        'The controls of <position name="aim"> and <motor name="push"> are 0, because no keyframe has them.'
    )
    assert joint.startswith('The `actuatorfrcrange` of <joint name="swing"> was not imported, because')
    assert aim.startswith('The `ctrlrange` of <position name="aim"> was not imported, because')
    assert push.startswith('The `ctrlrange` of <motor name="push"> was not imported, because')
    assert main(["import", str(robot), "--quiet"]) == 0
    assert capsys.readouterr().err == ""
    assert main(["import", str(robot)]) == 0
    captured = capsys.readouterr()
    assert captured.err.splitlines() == lines[:-1]
    assert captured.out == (tmp_path / "robot.toml").read_text()
