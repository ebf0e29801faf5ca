"""What cannot be read is refused by its name, with what to do."""

import pytest

from jaxball.files.urdf import URDFError, read_urdf
from tests.support.sentences import refuses

from .robots import URDF, added

BODY = '<inertial><mass value="1"/><inertia ixx="0.1" iyy="0.1" izz="0.1"/></inertial>'


def with_link(shape, kind="continuous", body=BODY, purpose="collision", joint=""):
    """The robot with one more link on the shell, 0.1 beside its centre."""
    geometry = f"<{purpose}><geometry>{shape}</geometry></{purpose}>" if shape else ""
    at = '<origin xyz="0 0.1 0"/><parent link="shell"/><child link="more"/>'
    return added(
        URDF, f'<link name="more">{body}{geometry}</link>', f'<joint name="added" type="{kind}">{at}{joint}</joint>'
    )


REFUSALS = {
    "planar": (with_link("", "planar"), "added"),
    "floating": (with_link("", "floating"), "floating"),
    "ball": (with_link("", "ball"), "ball"),
    "no type": (URDF.replace(' type="continuous"', ""), '<joint name="axle">'),
    "mesh": (with_link('<mesh filename="a.stl"/>', body="", purpose="visual"), "more"),
    "wheel": (with_link('<cylinder radius="0.24" length="0.02"/>'), "more"),
    "box": (with_link('<box size="0.2 0.4 0.1"/>'), '<link name="more">'),
    "capsule": (with_link('<capsule radius="0.2" length="0.1"/>'), '<link name="more">'),
    "two spheres": (with_link('<sphere radius="0.1"/>'), "shell"),
    "no sphere": (URDF.replace('<sphere radius="0.3"/>', '<mesh filename="a.stl"/>'), "…"),
    "two roots": (added(URDF, f'<link name="alone">{BODY}</link>'), "shell"),
    "no root": (
        added(URDF, '<joint name="back" type="fixed"><parent link="slider"/><child link="shell"/></joint>'),
        "There",
    ),
    "a loop": (
        added(
            URDF,
            '<link name="a"/><link name="b"/>',
            '<joint name="ab" type="fixed"><parent link="a"/><child link="b"/></joint>',
            '<joint name="ba" type="fixed"><parent link="b"/><child link="a"/></joint>',
        ),
        "a",
    ),
    "two parents": (
        added(URDF, '<joint name="more" type="fixed"><parent link="shell"/><child link="slider"/></joint>'),
        "slider",
    ),
    "bolted": (
        added(
            URDF,
            '<link name="world"/><joint name="bolts" type="fixed"><parent link="world"/><child link="shell"/></joint>',
        ),
        "bolts",
    ),
    "mimic": (with_link("", joint='<mimic joint="axle"/>'), "added"),
    "no link": (URDF.replace('<child link="yoke"/>', '<child link="yolk"/>'), "axle"),
    "no child": (URDF.replace('<child link="yoke"/>', ""), "axle"),
    "no name": (URDF.replace('<link name="yoke">', "<link>"), "name"),
    "same name": (added(URDF, '<link name="yoke"/>'), "yoke"),
    "no mass": (URDF.replace('<mass value="0.5"/>', ""), "yoke"),
    "zero mass": (URDF.replace('<mass value="0.5"/>', '<mass value="0"/>'), "yoke"),
    "moments": (URDF.replace('iyy="0.002" izz="0.004"', 'iyy="0.002" izz="0.04"'), "yoke"),
    "no axis": (URDF.replace('<axis xyz="0 1 0"/>', '<axis xyz="0 0 0"/>'), "axle"),
    "number": (URDF.replace('radius="0.3"', 'radius="big"'), "radius"),
    "no radius": (URDF.replace('radius="0.3"', 'radius="0"'), "radius"),
    "missing": (URDF.replace(' radius="0.3"', ""), "radius"),
    "damping": (URDF.replace('damping="0.05"', 'damping="-0.05"'), "damping"),
    "light link": (with_link("", body=""), "joints[0]"),
    "shape": (with_link("<cone/>"), "more"),
    "xacro": (URDF.replace('value="0.5"', 'value="${mass}"'), "xacro robot.urdf.xacro > robot.urdf"),
    "macro": (
        URDF.replace("<robot ", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" ').replace(
            "</robot>", '<xacro:bob r="1"/></robot>'
        ),
        "xacro robot.urdf.xacro > robot.urdf",
    ),
    "entity": (
        URDF.replace("<robot", '<!DOCTYPE robot [<!ENTITY bob SYSTEM "file:///etc/hostname">]><robot'),
        "The file",
    ),
    "no XML": ("robot <", "The file"),
    "a misspelt attribute": (URDF.replace('damping="0.05"', 'dampng="0.05"'), "dampng"),
    "an attribute of another element": (
        URDF.replace('<mass value="0.5"/>', '<mass value="0.5" density="3"/>'),
        "density",
    ),
    "a misspelt element": (URDF.replace('<dynamics damping="0.05"/>', '<dinamics damping="0.05"/>'), "swing"),
    "a misspelt link": (added(URDF, '<lnk name="a"/>'), "link"),
    "two dampers": (
        URDF.replace('<dynamics damping="0.05"/>', '<dynamics damping="0.05"/><dynamics damping="0.5"/>'),
        "swing",
    ),
    "no file": ("robot.urdf", "source"),
    "MJCF": ("<mujoco/>", "The file"),
    "empty": ("<robot/>", "The file"),
}


@pytest.mark.parametrize(("text", "named"), REFUSALS.values(), ids=REFUSALS)
def test_what_is_no_such_robot_is_refused_with_a_sentence(text, named):
    with refuses(URDFError, named):
        read_urdf(text)


@pytest.mark.parametrize("gravity", [-1.0, float("nan")])
def test_gravity_that_is_none_is_refused(gravity):
    with refuses(ValueError, "gravity"):
        read_urdf(URDF, gravity=gravity)


def test_a_shell_without_mass_is_refused():
    text = '<robot><link name="shell"><collision><geometry><sphere radius="1"/></geometry></collision></link></robot>'
    with refuses(URDFError, "shell"):
        read_urdf(text)


def test_the_shell_is_named_where_there_are_several_spheres():
    bob = with_link('<sphere radius="0.1"/>')
    assert float(read_urdf(bob, shell="shell").scenario.system.radius) == 0.3
    with refuses(URDFError, "shell"):
        read_urdf(bob, shell="more")
    with refuses(URDFError, "shell"):
        read_urdf(bob, shell="shel")
    with refuses(URDFError, "yoke"):
        read_urdf(bob, shell="yoke")


def test_a_visual_is_the_shell_where_nothing_has_a_sphere_for_contacts():
    text = URDF.replace("collision", "visual")
    assert float(read_urdf(text).scenario.system.radius) == 0.3
