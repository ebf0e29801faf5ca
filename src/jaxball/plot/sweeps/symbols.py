"""The labels of numbers of a scenario in figures of studies: the paper's symbols and units instead of their paths."""

import re
from collections.abc import Mapping

# The path of a number, in which # stands for an index, with its symbol, in which # stands for that index from 1, and
# its unit.
NUMBERS = {
    "body.mass": ("m_0", "mass"),
    "body.radius": ("r", "length"),
    "body.gravity": ("g", "length/time²"),
    "body.inertia": ("d", "mass length²"),
    "body.inertia[#]": ("d_{#}", "mass length²"),
    "body.offset[#]": (r"\chi_{0,#}", "length"),
    "body.chi[#]": (r"\chi_{#}", "length"),
    "masses[#].mass": ("m_{#}", "mass"),
    "masses[#].rail.radius": ("r_{#}", "length"),
    "masses[#].rail.semi_axes[#]": ("a_{#,#}", "length"),
    "masses[#].schedule.theta": (r"\theta_{#}(t_0)", "rad"),
    "masses[#].schedule.rate": (r"\dot{\theta}_{#}", "rad/time"),
    "masses[#].schedule.height": (r"\ddot{\theta}_{#}", "rad/time²"),
    "mechanisms[#].masses[#].mass": ("M_{#,#}", "mass"),
    "ground.angle": ("a", "rad"),
    "ground.heading": ("b", "rad"),
    "contact.sliding": (r"\mu", ""),
    "contact.static": (r"\mu_s", ""),
    "contact.restitution": ("e", ""),
    "initial.Omega[#]": (r"\Omega_{#}(t_0)", "rad/time"),
    "initial.phi": (r"\phi(t_0)", "rad"),
    "initial.phidot": (r"\dot{\phi}(t_0)", "rad/time"),
    "initial.z": ("z(t_0)", "length"),
    "initial.z[#]": ("z_{#}(t_0)", "length"),
    "initial.theta[#]": (r"\theta_{#}(t_0)", ""),
    "initial.thetadot[#]": (r"\dot{\theta}_{#}(t_0)", ""),
    "initial.velocity[#]": ("V_{#}(t_0)", "length/time"),
    "initial.height": ("h(t_0)", "length"),
    "time.end": ("t_1", "time"),
}
Labels = Mapping[str, str] | None
GREEK = {
    "Gamma": "Γ",
    "Lambda": "Λ",
    "Omega": "Ω",
    "chi": "χ",
    "lambda": "λ",
    "mu": "μ",
    "phi": "φ",
    "theta": "θ",
}
SUBSCRIPTS = str.maketrans("0123456789sx", "₀₁₂₃₄₅₆₇₈₉ₛₓ")


def number_label(path: str, labels: Labels = None, *, with_unit: bool = True) -> str:
    """The label of the number at a path: from ``labels``, its symbol and unit, or its path."""
    if labels and path in labels:
        return labels[path]
    indices = iter(re.findall(r"\[(\d+)\]", path))
    symbol, unit = NUMBERS.get(re.sub(r"\[\d+\]", "[#]", path), ("", ""))
    if not symbol:
        return path
    numbered = re.sub("#", lambda _: str(int(next(indices)) + 1), symbol)
    return f"${numbered}$" + (f" ({unit})" if unit and with_unit else "")


def plain(path: str) -> str:
    """A path as part of a file's name, without brackets: ``masses0.mass``, ``z0``."""
    return re.sub(r"[^\w.-]+", "_", re.sub(r"\[(\d+)\]", r"\1", path.replace("][", "]-["))).strip("_")


def in_plain_text(label: str) -> str:
    """A label in the characters of plain text, for a page without TeX: ``Ω₃(t₀) (rad/time)``."""
    text = re.sub(r"\\ddot\{(\\?\w+)\}", "\\1\N{COMBINING DIAERESIS}", label.replace("$", ""))
    text = re.sub(r"\\dot\{(\\?\w+)\}", "\\1\N{COMBINING DOT ABOVE}", text)
    text = re.sub(r"\\([A-Za-z]+)", lambda found: GREEK.get(found[1], found[1]), text)
    return re.sub(r"_\{([^}]*)\}|_(\w)", lambda found: _lowered(found[1] or found[2]), text)


def _lowered(subscript: str) -> str:
    """As a subscript, if there is a sign for each of its characters."""
    lowered = subscript.translate(SUBSCRIPTS)
    return f"_{subscript}" if re.search("[A-Za-z]", lowered) else lowered
