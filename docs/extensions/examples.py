"""What the gallery says of an example that its file does not: a short name, its robot, and what its pictures show."""

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Example:
    """Beside the file.

    - ``name``: short.
    - ``robot``: the entry of the gallery whose robot it has; its own, if it makes a picture of it.
    - ``pictures``: what is seen in each of its pictures, which it writes or, of a long one, once wrote.
    - ``long``: whether it takes minutes. Then it is not run, and its pictures stand in ``docs/figures``.
    """

    name: str
    robot: str = ""
    pictures: Mapping[str, str] = field(default_factory=dict)
    long: bool = False


EXAMPLES = {
    "01_first_ball.py": Example(
        "First ball",
        pictures={"first_ball.png": "A ball at the end of its straight path, with a mass on a circle inside"},
    ),
    "02_own_rail_and_law.py": Example(
        "Own rail and law",
        pictures={"trefoil.png": "A ball at the end of its bent path, with a mass on a rail that is a trefoil knot"},
    ),
    "03_gradient.py": Example("Gradient", "example-first-ball"),
    "04_sweep.py": Example(
        "Sweep",
        "example-first-ball",
        {
            "distances.png": "Colours over the mass and the radius of its rail: the larger both are, the farther the "
            "ball is after five units of time, up to 3.8 radii"
        },
    ),
    "05_balance.py": Example(
        "Balance",
        pictures={
            "balanced.png": "A ball at its start with three masses on circles, placed so that its centre of mass is "
            "exactly above its geometric centre"
        },
    ),
    "06_ode_and_dae.py": Example("ODE and DAE", "ball"),
    "07_two_principles.py": Example(
        "Two principles",
        "nonholonomic-particle",
        {
            "two_principles.png": "x, y and the momentum along y of both particles over time: they start alike and "
            "separate, and only under the Lagrange–d'Alembert principle is the momentum constant"
        },
    ),
    "08_identification.py": Example("Identification", "ball"),
    "09_own_system.py": Example(
        "Own system",
        pictures={
            "sleigh.png": "The path of the sleigh's blade: a sharp bend to the left and then nearly a straight line, "
            "with a dot where it crosses y = 1"
        },
    ),
    "10_wobble.py": Example(
        "Wobble",
        "roboball",
        {
            "roboball-wobble.png": "Growth rates over speed and both resistances: a band of speeds at which the robot "
            "wobbles, which resistance to rolling ends and resistance to spinning widens"
        },
        long=True,
    ),
    "11_measured_robot.py": Example(
        "Measured robot",
        "roboball-2",
        {
            "measured-robot.png": "Angles over time, measured as dots and predicted as lines: in the stand a pendulum "
            "that swings less and less and stops, on the floor a shell that rocks with its pendulum"
        },
        long=True,
    ),
    "12_flipping_ball.py": Example(
        "Flipping ball",
        "oblate-ball",
        {
            "flipping-ball.png": "The angle between axle and rotation, the axle's elevation, and the energy over time: "
            "with the smaller moment about its axle a ball wobbles more and more until it flips over and over, with "
            "the larger it rolls on; dots of the energy without what friction took are on its lines"
        },
    ),
    "ball_past_a_post.py": Example(
        "Ball past a post",
        "ball",
        {
            "ball-past-a-post-path.png": "Two paths from above, with a round post on the straight line between start "
            "and end: the one before crosses the edge of the post, the one after passes it at a distance"
        },
        long=True,
    ),
    "compare_robust_rails.py": Example("Compare robust rails", "example-designed-robust-rails", long=True),
    "designed_rails.toml": Example("Designed rails"),
    "designed_robust_rails.toml": Example("Designed robust rails"),
    "disk_tracking.py": Example(
        "Disk tracking",
        "disk",
        {
            "disk-tracking-path.png": "The place of the disk over time, there and back: with a small weight it "
            "stays below its target, with a large one it coincides with it"
        },
        long=True,
    ),
    "figure_eight_held.py": Example(
        "Figure eight held",
        "six-tubes",
        {
            "figure-eight-held.png": "Paths from above: without feedback the ball leaves the figure eight after two "
            "pushes, with feedback of the state or of what sensors read it stays on it"
        },
        long=True,
    ),
    "problem_disk_control.toml": Example("Problem: disk, control", "disk"),
    "problem_disk_on_top.toml": Example("Problem: disk, masses on top", "disk"),
    "problem_disk_tracking.toml": Example("Problem: disk, tracking", "disk"),
    "problem_pendulum_on_a_slope.toml": Example(
        "Problem: pendulum on a slope",
        "pendulum-and-yoke",
        {
            "climb-torques.png": "Two torques over time: that of the yoke, solid, is 2.5 until t = 1.7 and then falls "
            "in waves to −0.5; that of the pendulum, dashed, stays between −0.6 and 0.9"
        },
        long=True,
    ),
    "problem_rail_shape.toml": Example(
        "Problem: rail shape",
        "example-designed-rails",
        {
            "designed-rails.png": "Three closed, bent rails in the shell, each with its mass",
            "designed-path.png": "Paths from above: a straight one before the search, and after it one that coincides "
            "with the sigmoid that is the target",
        },
        long=True,
    ),
    "problem_rail_shape_circles.toml": Example("Problem: rail shape, circles", "ball"),
    "problem_robust_rails.toml": Example("Problem: robust rails", "example-designed-robust-rails"),
    "six_tubes.py": Example(
        "Six tubes, figure eight",
        "six-tubes",
        {
            "figure-eight-tubes.png": "The places of the six masses along their tubes over time, in three pairs that "
            "nearly coincide but for their start and end",
            "figure-eight-path.png": "Paths from above: in grey, with a small weight, a flat and slanted figure eight; "
            "in red, with a large one, the figure eight that is the target",
        },
        long=True,
    ),
    "train_with_skrl.py": Example("Training with skrl", "disk", long=True),
}
