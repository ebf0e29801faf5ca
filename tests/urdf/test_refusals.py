"""What cannot be read is refused by its name, with what to do."""

import re

import pytest

from jaxball.urdf import URDFError, from_urdf

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
    "planar": (
        with_link("", "planar"),
        'Element <joint name="added"> must be of the type revolute, continuous, prismatic or fixed inside a shell, but '
        'its type is "planar"; write two prismatic joints and a continuous one instead.',
    ),
    "floating": (
        with_link("", "floating"),
        'but its type is "floating"; write three prismatic and three continuous joints instead.',
    ),
    "ball": (with_link("", "ball"), 'but its type is "ball"; write three continuous joints instead.'),
    "no type": (URDF.replace(' type="continuous"', ""), 'but its type is "".'),
    "mesh": (
        with_link('<mesh filename="a.stl"/>', body="", purpose="visual"),
        'Element <link name="more"> must have an <inertial>, because the mass of its mesh is not computed here, but it '
        "has none; state its mass and its inertia.",
    ),
    "wheel": (
        with_link('<cylinder radius="0.24" length="0.02"/>'),
        'The <collision> of <link name="more"> must be inside the shell, a sphere of radius 0.3, because only the '
        "shell rolls here, but it reaches 0.340147 from its centre; wheels on the ground have no counterpart, and what "
        "never touches it needs no <collision>.",
    ),
    "box": (with_link('<box size="0.2 0.4 0.1"/>'), "but it reaches 0.320156 from its centre"),
    "capsule": (with_link('<capsule radius="0.2" length="0.1"/>'), "but it reaches 0.311803 from its centre"),
    "two spheres": (
        with_link('<sphere radius="0.1"/>'),
        'There must be one sphere, the shell, but 2 are in <link name="shell"> and <link name="more">; name the link '
        "that rolls, `shell`, which contains the others.",
    ),
    "no sphere": (
        URDF.replace('<sphere radius="0.3"/>', '<mesh filename="a.stl"/>'),
        "There must be a link with a sphere, which rolls, but there is none; give the <collision> of the shell a "
        '<sphere radius="…"/>.',
    ),
    "two roots": (
        added(URDF, f'<link name="alone">{BODY}</link>'),
        'There must be one link that is no child of a joint, the root, but there are <link name="shell"> and '
        '<link name="alone">; join all links to one by joints.',
    ),
    "no root": (
        added(URDF, '<joint name="back" type="fixed"><parent link="slider"/><child link="shell"/></joint>'),
        "There must be one link that is no child of a joint, the root, but every link is one;",
    ),
    "a loop": (
        added(
            URDF,
            '<link name="a"/><link name="b"/>',
            '<joint name="ab" type="fixed"><parent link="a"/><child link="b"/></joint>',
            '<joint name="ba" type="fixed"><parent link="b"/><child link="a"/></joint>',
        ),
        'The joints must be a tree, but <link name="a"> and <link name="b"> are in a loop; leave one of its joints '
        "out.",
    ),
    "two parents": (
        added(URDF, '<joint name="more" type="fixed"><parent link="shell"/><child link="slider"/></joint>'),
        'Element <link name="slider"> must be the child of one joint, but it is that of <joint name="slide"> and '
        '<joint name="more">; leave one of them out.',
    ),
    "bolted": (
        added(
            URDF,
            '<link name="world"/><joint name="bolts" type="fixed"><parent link="world"/><child link="shell"/></joint>',
        ),
        'Element <joint name="bolts"> must be of the type floating, because the robot rolls, but it is fixed to the '
        'link "world"; leave both out.',
    ),
    "mimic": (
        with_link("", joint='<mimic joint="axle"/>'),
        'Element <mimic> of <joint name="added"> must be left out, because a joint that follows another has no '
        "counterpart here; drive it in the scenario.",
    ),
    "no link": (
        URDF.replace('<child link="yoke"/>', '<child link="yolk"/>'),
        'The <child> of <joint name="axle"> must be a link of the file, but it is "yolk".',
    ),
    "no child": (
        URDF.replace('<child link="yoke"/>', ""),
        'The <child> of <joint name="axle"> must be a link of the file, but it has none.',
    ),
    "no name": (
        URDF.replace('<link name="yoke">', "<link>"),
        "Every <link> must have a `name`, but one of them has none",
    ),
    "same name": (
        added(URDF, '<link name="yoke"/>'),
        'Element <link name="yoke"> must have a name of its own, but there are two with this one.',
    ),
    "no mass": (
        URDF.replace('<mass value="0.5"/>', ""),
        'Element <inertial> in <link name="yoke"> must have a <mass>, but it is missing.',
    ),
    "zero mass": (
        URDF.replace('<mass value="0.5"/>', '<mass value="0"/>'),
        'The mass of <link name="yoke"> must be positive, or 0 without moments, but it is 0.',
    ),
    "moments": (
        URDF.replace('iyy="0.002" izz="0.004"', 'iyy="0.002" izz="0.04"'),
        'The inertia of <link name="yoke"> must have principal moments of which none exceeds the sum of the other two, '
        "as in every real body, but they are 0.003, 0.002, 0.04; correct it.",
    ),
    "no axis": (
        URDF.replace('<axis xyz="0 1 0"/>', '<axis xyz="0 0 0"/>'),
        'The <axis> of <joint name="axle"> must be a direction, but it is 0.',
    ),
    "number": (
        URDF.replace('radius="0.3"', 'radius="big"'),
        'Attribute `radius` of <sphere> in <link name="shell"> must be a number, but it is "big".',
    ),
    "missing": (
        URDF.replace(' radius="0.3"', ""),
        'Element <sphere> in <link name="shell"> must have `radius`, a number, but it is missing.',
    ),
    "damping": (
        URDF.replace('damping="0.05"', 'damping="-0.05"'),
        'The `damping` of <joint name="swing"> must be 0 or positive, but it is -0.05.',
    ),
    "light link": (
        with_link("", body=""),
        'The links on <joint name="added"> are no mechanism: ',
    ),
    "shape": (
        with_link("<cone/>"),
        'The <geometry> of <collision> in <link name="more"> must be one of <sphere>, <box>, <cylinder>, <capsule>, '
        "<mesh>, but it is <cone>.",
    ),
    "xacro": (
        URDF.replace('value="0.5"', 'value="${mass}"'),
        "The file must be expanded by xacro, but it has <mass> with a macro or an expression; run "
        "`xacro robot.urdf.xacro > robot.urdf`.",
    ),
    "macro": (
        URDF.replace("<robot ", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" ').replace(
            "</robot>", '<xacro:bob r="1"/></robot>'
        ),
        "The file must be expanded by xacro, but it has <bob> with a macro",
    ),
    "entity": (
        URDF.replace("<robot", '<!DOCTYPE robot [<!ENTITY bob SYSTEM "file:///etc/hostname">]><robot'),
        "The file must have no document type and no entities, but it declares some; leave them out.",
    ),
    "no XML": ("robot <", "The file must be XML, but it is not: "),
    "a misspelt attribute": (
        URDF.replace('damping="0.05"', 'dampng="0.05"'),
        'Attribute `dampng` of <dynamics> in <joint name="swing"> must be one that URDF has; did you mean `damping`?',
    ),
    "an attribute of another element": (
        URDF.replace('<mass value="0.5"/>', '<mass value="0.5" density="3"/>'),
        'Attribute `density` of <mass> in <link name="yoke"> must be one that URDF has.',
    ),
    "a misspelt element": (
        URDF.replace('<dynamics damping="0.05"/>', '<dinamics damping="0.05"/>'),
        'Element <dinamics> in <joint name="swing"> must be one that URDF has; did you mean "dynamics"?',
    ),
    "a misspelt link": (
        added(URDF, '<lnk name="a"/>'),
        'Element <lnk> in <robot name="pendulum robot"> must be one that URDF has; did you mean "link"?',
    ),
    "two dampers": (
        URDF.replace('<dynamics damping="0.05"/>', '<dynamics damping="0.05"/><dynamics damping="0.5"/>'),
        'There must be one <dynamics> in <joint name="swing">, but there are 2; leave the others out.',
    ),
    "no file": (
        "robot.urdf",
        'Argument `source` must be the path of a URDF file, or its text, but it is "robot.urdf" (No such file or',
    ),
    "MJCF": ("<mujoco/>", "The file must have <robot> as its root, but it has <mujoco>."),
    "empty": ("<robot/>", "The file must have a <link>, the shell, but it has none."),
}


@pytest.mark.parametrize(("text", "sentence"), REFUSALS.values(), ids=REFUSALS)
def test_what_is_no_such_robot_is_refused_with_a_sentence(text, sentence):
    with pytest.raises(URDFError, match=re.escape(sentence)):
        from_urdf(text)


def test_a_shell_without_mass_is_refused():
    text = '<robot><link name="shell"><collision><geometry><sphere radius="1"/></geometry></collision></link></robot>'
    with pytest.raises(URDFError, match='Element <link name="shell"> must have an <inertial>, but it has none'):
        from_urdf(text)


def test_the_shell_is_named_where_there_are_several_spheres():
    bob = with_link('<sphere radius="0.1"/>')
    assert float(from_urdf(bob, shell="shell").system.radius) == 0.3
    with pytest.raises(URDFError, match=r'of <link name="shell"> must be inside the shell, a sphere of radius 0\.1'):
        from_urdf(bob, shell="more")
    with pytest.raises(URDFError, match='`shell` must be a link of the file, but it is "shel"; did you mean "shell"'):
        from_urdf(bob, shell="shel")
    with pytest.raises(
        URDFError, match='Element <link name="yoke"> must have a sphere, which rolls, but there is none'
    ):
        from_urdf(bob, shell="yoke")


def test_a_visual_is_the_shell_where_nothing_has_a_sphere_for_contacts():
    text = URDF.replace("collision", "visual")
    assert float(from_urdf(text).system.radius) == 0.3
