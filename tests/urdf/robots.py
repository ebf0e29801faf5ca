"""A pendulum-driven spherical robot in URDF, in MJCF and in Python: the same links, joints and inertias."""

import numpy as np
from scipy.spatial.transform import Rotation

from jaxball import (
    Ball,
    Damper,
    Hinge,
    JointFriction,
    MatrixFrame,
    Mechanism,
    Slider,
    rigid_body_masses,
)

# The shell, a plate fixed in it, a yoke that turns about the axle, a pendulum on the yoke, and a slider on the yoke.
URDF = """<?xml version="1.0"?>
<robot name="pendulum robot">
  <link name="shell">
    <inertial><origin xyz="0.01 0 -0.02"/><mass value="2.0"/>
      <inertia ixx="0.05" iyy="0.06" izz="0.055" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><geometry><mesh filename="package://robot/shell.stl"/></geometry></visual>
    <collision><geometry><sphere radius="0.3"/></geometry></collision>
  </link>
  <link name="yoke">
    <inertial><origin xyz="0 0 0.02" rpy="0.3 -0.2 0.5"/><mass value="0.5"/>
      <inertia ixx="0.003" iyy="0.002" izz="0.004" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><geometry><box size="0.1 0.2 0.02"/></geometry></visual>
  </link>
  <link name="pendulum">
    <inertial><origin xyz="0 0 -0.15"/><mass value="1.5"/>
      <inertia ixx="0.004" iyy="0.005" izz="0.003" ixy="0.0005" ixz="-0.0002" iyz="0.0003"/></inertial>
    <collision><origin xyz="0 0 -0.15"/><geometry><cylinder radius="0.03" length="0.08"/></geometry></collision>
  </link>
  <link name="slider">
    <inertial><mass value="0.2"/><inertia ixx="0.0001" iyy="0.0001" izz="0.0001" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  <joint name="axle" type="continuous">
    <origin xyz="0 0.02 0.03" rpy="0.1 0.2 -0.4"/><parent link="shell"/><child link="yoke"/>
    <axis xyz="0 1 0"/><dynamics damping="0.02" friction="0.01"/>
  </joint>
  <joint name="swing" type="revolute">
    <origin xyz="0.01 0 -0.02" rpy="0 0 0.3"/><parent link="yoke"/><child link="pendulum"/>
    <axis xyz="1 0 0.5"/><limit lower="-1" upper="1.2" effort="2" velocity="5"/><dynamics damping="0.05"/>
  </joint>
  <joint name="slide" type="prismatic">
    <origin xyz="0.05 0 0.05"/><parent link="yoke"/><child link="slider"/>
    <axis xyz="0 0.6 0.8"/><limit lower="-0.05" upper="0.05" effort="1" velocity="1"/>
  </joint>
</robot>
"""
MJCF = """<mujoco model="pendulum robot"><compiler angle="radian" eulerseq="XYZ"/><worldbody>
  <geom type="plane" size="1 1 0.1"/>
  <body name="shell" pos="0 0 0.3"><freejoint/>
    <inertial pos="0.01 0 -0.02" mass="2" diaginertia="0.05 0.06 0.055"/><geom size="0.3"/>
    <body name="yoke" pos="0 0.02 0.03" euler="0.1 0.2 -0.4">
      <joint name="axle" axis="0 1 0" damping="0.02" frictionloss="0.01"/>
      <inertial pos="0 0 0.02" euler="0.3 -0.2 0.5" mass="0.5" diaginertia="0.003 0.002 0.004"/>
      <body name="pendulum" pos="0.01 0 -0.02" euler="0 0 0.3">
        <joint name="swing" axis="1 0 0.5" damping="0.05"/>
        <inertial pos="0 0 -0.15" mass="1.5" fullinertia="0.004 0.005 0.003 0.0005 -0.0002 0.0003"/>
      </body>
      <body name="slider" pos="0.05 0 0.05">
        <joint name="slide" type="slide" axis="0 0.6 0.8"/>
        <inertial pos="0 0 0" mass="0.2" diaginertia="0.0001 0.0001 0.0001"/>
      </body>
    </body>
  </body>
</worldbody></mujoco>
"""


def added(text, *elements):
    """The file with more elements at its end."""
    return text.replace("</robot>", f"{''.join(elements)}</robot>")


def turned(*rpy):
    """Rx(r) after Ry(p) after Rz(y) as matrices, about fixed axes in the order x, y, z."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy), np.sin(rpy)
    x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    return z @ y @ x


def in_python():
    """The robot by the classes of mechanisms, with its frames multiplied by hand."""
    yoke, at_yoke = turned(0.1, 0.2, -0.4), np.array([0.0, 0.02, 0.03])
    pendulum, at_pendulum = yoke @ turned(0.0, 0.0, 0.3), at_yoke + yoke @ [0.01, 0.0, -0.02]
    at_slider = at_yoke + yoke @ [0.05, 0.0, 0.05]
    full = np.array([[0.004, 0.0005, -0.0002], [0.0005, 0.005, 0.0003], [-0.0002, 0.0003, 0.003]])
    moments, axes = np.linalg.eigh(full)
    axes = axes * np.array([1.0, 1.0, np.linalg.det(axes)])
    joints = [
        Hinge(yoke @ [0.0, 1.0, 0.0], at_yoke, Damper(0.02) + JointFriction(0.01)),
        Hinge(pendulum @ [1.0, 0.0, 0.5], at_pendulum, Damper(0.05)),
        Slider(yoke @ [0.0, 0.6, 0.8], None, 0),
    ]
    masses = [
        *rigid_body_masses(
            0.5,
            (0.003, 0.002, 0.004),
            centre=at_yoke + yoke @ [0.0, 0.0, 0.02],
            frame=MatrixFrame(yoke @ turned(0.3, -0.2, 0.5)),
            joint=0,
        ),
        *rigid_body_masses(
            1.5, moments, centre=at_pendulum + pendulum @ [0.0, 0.0, -0.15], frame=MatrixFrame(pendulum @ axes), joint=1
        ),
        *rigid_body_masses(0.2, (0.0001,) * 3, centre=at_slider, joint=2),
    ]
    return Ball(
        mass=2.0,
        radius=0.3,
        inertia=(0.05, 0.06, 0.055),
        gravity=9.81,
        offset=(0.01, 0.0, -0.02),
        mechanisms=(Mechanism(joints, masses),),
    )


# The same inside out: the root is a frame with a weight, on an axle in the shell, to which a plate is fixed.
INSIDE_OUT = """<robot name="inside out">
  <link name="world"/><link name="footprint"/>
  <joint name="free" type="floating"><parent link="world"/><child link="footprint"/></joint>
  <joint name="base" type="fixed"><parent link="footprint"/><child link="frame"/></joint>
  <link name="frame">
    <inertial><origin xyz="0 0.01 -0.1"/><mass value="1.5"/>
      <inertia ixx="0.004" iyy="0.005" izz="0.003" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  <link name="shell">
    <inertial><mass value="2.0"/><inertia ixx="0.05" iyy="0.06" izz="0.055" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><geometry><sphere radius="0.3"/></geometry></collision>
  </link>
  <joint name="axle" type="continuous">
    <origin xyz="0.02 -0.01 0.03" rpy="0.2 -0.1 0.4"/><parent link="frame"/><child link="shell"/>
    <axis xyz="0.2 1 0"/><dynamics damping="0.02"/>
  </joint>
  <link name="plate">
    <inertial><mass value="0.3"/><inertia ixx="0.001" iyy="0.001" izz="0.002" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  <joint name="bolts" type="fixed">
    <origin xyz="0.1 0.05 0.12" rpy="0.5 0.3 0.1"/><parent link="shell"/><child link="plate"/>
  </joint>
</robot>
"""


def rotation(q):
    return Rotation.from_quat(np.roll(q, -1)).as_matrix()
