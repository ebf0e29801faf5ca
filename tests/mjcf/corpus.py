"""A corpus of files: the same few kinds of robots, each feature of which is written in one of MuJoCo's many ways.

Robots of a kind have the same joints with the same kinds of forces, so that their equations compile once.
"""

import dataclasses

import numpy as np

VARIANTS = 16  # of each kind
KINDS = [("pendulum", "springs"), ("chain", "servos"), ("branches", "motors")]
AXES = "xyzXYZ"


def words(values):
    """Numbers as the text of an attribute, with every digit."""
    return " ".join(repr(float(x)) for x in np.ravel(values))


@dataclasses.dataclass
class Writer:
    """Chooses the ways of writing, by random numbers, and keeps what belongs at the top of the file."""

    rng: np.random.Generator

    def __post_init__(self):
        rng = self.rng
        self.radians = rng.random() < 0.5
        self.sequence = "".join(rng.choice(list(AXES), 3))
        self.classes = rng.random() < 0.5
        angle = "radian" if self.radians else "degree"
        limits = rng.choice(["", ' autolimits="true"'])
        self.compilers = rng.choice(
            [
                f'<compiler angle="{angle}" eulerseq="{self.sequence}"{limits}/>',
                f'<compiler eulerseq="{self.sequence}"/><compiler angle="{angle}" coordinate="local"{limits}/>',
                f'<compiler angle="degree" eulerseq="{self.sequence}" settotalmass="-1"/><compiler angle="{angle}"/>',
            ]
        )

    def one_of(self, *choices):
        return choices[self.rng.integers(len(choices))]

    def near(self, *values):
        """Numbers of the size of these, positive."""
        return np.asarray(values) * self.rng.uniform(0.5, 1.5, len(values))

    def place(self, size=0.05):
        return self.rng.uniform(-size, size, 3)

    def angle(self, value):
        return value if self.radians else np.degrees(value)

    def turn(self):
        """An orientation."""
        vector = self.rng.normal(size=3)
        kind = self.one_of("quat", "axisangle", "xyaxes", "zaxis", "euler", "")
        numbers = {
            "quat": self.rng.normal(size=4),
            "axisangle": [*vector, self.angle(self.rng.uniform(-3, 3))],
            "xyaxes": self.rng.normal(size=6),
            "zaxis": vector,
            "euler": self.angle(self.rng.uniform(-3, 3, 3)),
        }
        return f'{kind}="{words(numbers[kind])}"' if kind else ""

    def inertia(self):
        """The inertia of a rigid body: stated, or that of one to three geoms."""
        if self.rng.random() < 0.4:
            moments = self.near(2e-3, 2e-3, 2e-3) + 1e-3
            full = f'fullinertia="{words([*moments, *self.rng.uniform(-4e-4, 4e-4, 3)])}"'
            given = self.one_of(f'diaginertia="{words(moments)}" {self.turn()}', full)
            return f'<inertial pos="{words(self.place())}" mass="{words(self.near(0.4))}" {given}/>'
        return "".join(self.geom() for _ in range(self.rng.integers(1, 4)))

    def geom(self):
        shape = self.one_of("sphere", "capsule", "cylinder", "box", "ellipsoid", "between")
        sizes = {"sphere": 1, "capsule": 2, "cylinder": 2, "box": 3, "ellipsoid": 3}
        weight = self.one_of(f'mass="{words(self.near(0.2))}"', f'density="{words(self.near(900))}"', "")
        if shape == "between":
            kind, where = self.one_of("capsule", "cylinder"), f'fromto="{words([*self.place(), *self.place()])}"'
            size = words(self.near(0.02))
        else:
            kind, where = shape, f'pos="{words(self.place())}" {self.turn()}'
            size = words(self.near(*[0.03] * sizes[shape]))
        mute = "" if self.classes else 'contype="0" conaffinity="0"'
        looks = self.one_of("", 'rgba="1 0 0 1" group="2"', 'friction="0.3" solref="0.01 1" user="1 2"')
        return f'<geom type="{kind}" size="{size}" {where} {weight} {mute} {looks}/>'

    def joint(self, name, kind, attributes=""):
        axis = "" if self.rng.random() < 0.2 else f'axis="{words(self.rng.normal(size=3))}"'
        pos = f'pos="{words(self.place())}"' if self.rng.random() < 0.5 else ""
        known = f'type="{kind}"' if kind == "slide" or self.rng.random() < 0.5 else ""
        idle = self.one_of("", 'group="1" margin="0.1"', 'limited="false" range="-1 1"', 'range="0 0" user="3"')
        return f'<joint name="{name}" {known} {axis} {pos} {attributes} {idle}/>'

    def body(self, name, inside, joints=""):
        """A rigid body with a point mass and what is inside."""
        bob = f'<body pos="{words(self.place())}"><inertial pos="0 0 0.01" mass="0.1" diaginertia="0 0 0"/></body>'
        site = f'<site name="{name}" pos="0 0 0.01"/>' if self.rng.random() < 0.5 else ""
        inner = f"{joints}{self.inertia()}{bob}{site}{inside}"
        return f'<body name="{name}" pos="{words(self.place())}" {self.turn()}>{inner}</body>'


def springs(writer):
    """A spring with a damper on the first joint, a motor on the second."""
    k, c, rest = writer.near(2.0, 0.1, 0.3)
    spring = writer.one_of(
        f'stiffness="{words(k)}" damping="{words(c)}" springref="{words(writer.angle(rest))}"',
        f'stiffness="{words(k)} 0 0" damping="{words(c)}"',
        f'springdamper="{words(writer.near(0.5, 1.0))}"',
    )
    gear, gain = writer.near(2.0, 3.0) * writer.rng.choice([-1, 1], 2)
    motor = writer.one_of(
        f'<motor joint="second" gear="{words(gear)} 0 0 0 0 0"/>',
        f'<motor name="m" jointinparent="second" gear="{words(gear)}" ctrlrange="0 0"/>',
        f'<general joint="second" gear="{words(gear)}" gainprm="{words(gain)}" dynprm="1 0 0" user="1"/>',
        f'<general joint="second" gainprm="{words(gain)} 1 2" biastype="none" biasprm="1 2 3" group="1"/>',
    )
    return spring, "", motor


def servos(writer):
    """A servo on the first joint, a damper on the second, of its own or of a motor that a control of 0 keeps still."""
    kp, kv, gear = writer.near(3.0, 0.2, 1.5)
    servo = writer.one_of(
        f'<position joint="first" kp="{words(kp)}" kv="{words(kv)}" gear="{words(-gear)}"/>',
        f'<position joint="first" kp="{words(kp)}" dampratio="{words(kv)}"/>',
        f'<general joint="first" biastype="affine" gainprm="{words(gear)}" biasprm="{words([0, -kp, -kv])}"/>',
        f'<general joint="first" biastype="affine" gainprm="{words(kp)}" biasprm="{words([0, -kp, kv])} 0 0"/>',
    )
    return "", f'damping="{words(kv)}"', servo


def motors(writer):
    """A motor with a limit on the first joint, a spring on the second."""
    gear, limit = writer.near(2.0, 0.3)
    motor = writer.one_of(
        f'<motor joint="first" gear="{words(gear)}" forcerange="{words([-limit, limit])}"/>',
        f'<motor joint="first" ctrllimited="true" ctrlrange="{words([-limit, limit])}"/>',
        f'<general joint="first" gear="{words(-gear)}" forcelimited="true" forcerange="{words([-limit, limit])}"/>',
    )
    return "", f'stiffness="{words(writer.near(1.0))}"', motor


FORCES = {"springs": springs, "servos": servos, "motors": motors}


def robot(tree, forces, seed):
    """The text of a file."""
    writer = Writer(np.random.default_rng(seed))
    first, second, actuator = FORCES[forces](writer)
    hinge = writer.joint("first", "hinge", first)
    if tree == "pendulum":
        inside = writer.body("arm", writer.body("fixed", ""), hinge + writer.joint("second", "hinge", second))
    elif tree == "chain":
        inner = writer.body("tip", "", writer.joint("second", "slide", second))
        inside = writer.body("arm", writer.body("fixed", inner), hinge)
    else:
        inside = writer.body("arm", "", hinge) + writer.body("other", "", writer.joint("second", "hinge", second))
    gravity = writer.one_of("0 0 -9.81", "0 0 -4", "-0 0 -7.5") if tree != "branches" else words([0.5, -0.3, -9.5])
    flag = writer.one_of("", '<flag warmstart="disable" gravity="enable"/>', '<flag energy="enable"/>')
    touching = 'contype="1" conaffinity="1"' if writer.classes else ""
    default = '<default{}><geom contype="0" conaffinity="0"/><site size="0.01"/></default>'
    default = default.format(writer.one_of("", ' class="main"')) if writer.classes else ""
    free = writer.one_of("<freejoint/>", '<joint type="free"/>', '<freejoint name="free" align="false"/>')
    mass, moments, ctrl = words(writer.near(2.0)), words(writer.near(0.05, 0.05, 0.05) + 0.02), words(writer.near(0.8))
    key = writer.one_of(f'<key ctrl="{ctrl}"/>', f'<key name="start" time="0" ctrl="{ctrl}"/><key time="1"/>')
    return f"""
<mujoco model="{tree} with {forces}, {seed}">
  {writer.compilers}
  <option gravity="{gravity}" timestep="0.001">{flag}</option>
  {default}
  <worldbody>
    <light pos="0 0 3"/>
    <geom type="plane" size="5 5 0.1" {touching}/>
    <body name="hull" pos="{words([*writer.place()[:2], 0.4])}" {writer.turn()}>
      {free}
      <inertial pos="{words(writer.place())}" mass="{mass}" diaginertia="{moments}" {writer.turn()}/>
      <geom size="0.4" pos="{words(writer.place(0.02))}" {touching}/>
      {inside}
    </body>
  </worldbody>
  <actuator>{actuator}</actuator>
  <contact><exclude body1="hull" body2="arm"/></contact>
  <keyframe>{key}</keyframe>
</mujoco>
"""
