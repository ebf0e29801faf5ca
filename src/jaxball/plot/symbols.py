"""The paper's symbols for the components of states and conserved quantities, in TeX."""

SYMBOLS = {
    "q": "q",
    "Lambda": r"\Lambda",
    "Omega": r"\Omega",
    "Gamma": r"\Gamma",
    "x": "x",
    "y": "y",
    "z": "z",
    "xdot": r"\dot{x}",
    "ydot": r"\dot{y}",
    "phi": r"\phi",
    "phidot": r"\dot{\phi}",
    "theta": r"\theta",
    "thetadot": r"\dot{\theta}",
    "multiplier": r"\lambda",
    "p_x": "p_x",
    "p_y": "p_y",
    "p_z": "p_z",
    "p_xz": "p_{xz}",
}


def symbol(path: str) -> str:
    """The symbol of a component by its path, which counts from 0: Ω₁ for ``Omega[0]``, but q₀ for ``q[0]``."""
    name, _, index = path.removesuffix("]").partition("[")
    subscript = f"_{{{int(index) if name == 'q' else int(index) + 1}}}" if index else ""
    return f"${SYMBOLS.get(name, name)}{subscript}$"
