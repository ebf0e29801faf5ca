"""The packages of jaxball, one floor for each layer of the contract in ``pyproject.toml`` that orders them."""

import tomllib
from pathlib import Path

from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch, Rectangle
from sketch import INK, PAPER, SMALL, WORDS, word

ROOT = Path(__file__).parents[2]
# Who asks for what, from the top; a package that is not here stands in the last group.
GROUPS = [
    ("what a user types", "#DDE6F0", ("cli",)),
    ("studies", "#E6EEDF", ("studies", "paper")),
    ("files and figures", "#F3E9D8", ("plot", "files")),
    ("what is asked of runs", "#EFE2EA", ("analysis", "control")),
    ("a run", "#E2EEEE", ("simulation",)),
    ("mechanics", "#F4E0DA", ("physics",)),
    ("tools", PAPER, ()),
]
WIDTH, HEIGHT, GAP = 9.0, 0.62, 0.14


def draw() -> Figure:
    floors = layers()
    figure = Figure(figsize=(7.8, 0.38 * len(floors) + 0.7), layout="constrained")
    ax = figure.add_subplot()
    ax.set_axis_off()
    for floor, packages in enumerate(floors):
        y = -floor * (HEIGHT + GAP)
        width = (WIDTH - GAP * (len(packages) - 1)) / len(packages)
        for place, package in enumerate(packages):
            x = place * (width + GAP)
            box = FancyBboxPatch((x, y), width, HEIGHT, boxstyle="round,pad=0,rounding_size=0.08")
            box.set(facecolor=_colour(package), edgecolor="0.6", linewidth=0.7)
            ax.add_patch(box)
            word(ax, (x + width / 2, y + HEIGHT / 2), package, fontproperties=WORDS)
    bottom = -(len(floors) - 1) * (HEIGHT + GAP)
    ax.annotate(
        "", xy=(-0.3, bottom), xytext=(-0.3, HEIGHT), arrowprops={"arrowstyle": "-|>", "color": INK, "linewidth": 0.9}
    )
    ax.text(-0.42, (bottom + HEIGHT) / 2, "imports", rotation=90, ha="right", va="center", fontproperties=SMALL)
    for place, (name, colour, _) in enumerate(GROUPS):
        column, row = place % 4, place // 4
        x, y = column * 2.35, bottom - 0.55 - 0.42 * row
        ax.add_patch(Rectangle((x, y), 0.22, 0.22, facecolor=colour, edgecolor="0.6", linewidth=0.7))
        ax.text(x + 0.32, y + 0.1, name, ha="left", va="center", fontproperties=SMALL)
    ax.set(xlim=(-0.8, WIDTH + 0.1), ylim=(bottom - 1.15, HEIGHT + 0.1))
    return figure


def layers() -> list[list[str]]:
    """The packages on each floor, from the top, as ``lint-imports`` checks them."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    (rooms,) = (contract for contract in contracts if contract.get("containers") == ["jaxball"])
    return [layer.split(" | ") for layer in rooms["layers"]]


def _colour(package: str) -> str:
    return next((colour for _, colour, members in GROUPS if package in members), PAPER)
