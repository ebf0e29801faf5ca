"""Steady and periodic motions, as lines, tables and content of JSON."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...scenario.paths import entries
from ...stability import PeriodicMotion, SteadyMotion
from .files import write_csv

Motion = SteadyMotion | PeriodicMotion
Names = Sequence[str]  # of attributes


def state_line(motion: Motion) -> str:
    """The state of a motion."""
    return ", ".join(f"{name} = {_numbers(leaf)}" for name, leaf in _state(motion).items())


def complex_numbers(values: np.ndarray) -> str:
    """Complex numbers, without parts that are mere rounding."""
    return ", ".join(map(_complex, values))


def content(motion: Motion, names: Names, complex_names: Names) -> dict[str, Any]:
    """A motion for JSON: its state and some of its attributes."""
    return {"state": _state(motion), **{name: getattr(motion, name) for name in (*names, *complex_names)}}


def save(motions: Sequence[Motion], path: Path, names: Names, complex_names: Names) -> None:
    """One row for each motion, its columns named by paths."""
    rows = [_row(motion, names, complex_names) for motion in motions]
    write_csv(path, rows[0] if rows else ["kind"], (row.values() for row in rows))


def _row(motion: Motion, names: Names, complex_names: Names) -> dict[str, Any]:
    row: dict[str, Any] = {}
    for name, values in _state(motion).items():
        row |= {entry: repr(float(values[index])) for entry, index in entries(name, values.shape).items()}
    for name in names:
        values = np.asarray(getattr(motion, name))
        row |= {entry: values[index].item() for entry, index in entries(name, values.shape).items()}
    for name in complex_names:
        for k, value in enumerate(getattr(motion, name)):
            one = f"{name.removesuffix('s')}[{k}]"
            row |= {f"{one}.real": repr(float(value.real)), f"{one}.imaginary": repr(float(value.imag))}
    return row


def _state(motion: Motion) -> dict[str, np.ndarray]:
    return {name: np.asarray(leaf) for name, leaf in vars(motion.state).items() if np.size(leaf)}


def _numbers(values: np.ndarray) -> str:
    return _number(float(values)) if values.ndim == 0 else f"({', '.join(map(_number, values.tolist()))})"


def _number(x: float) -> str:
    return f"{x + 0.0:.6g}" if abs(x) > 1e-12 else "0"


def _complex(value: complex) -> str:
    real, imaginary = (0.0 if abs(part) < 1e-9 else part for part in (value.real, value.imag))
    if not imaginary:
        return f"{real:.6g}"
    return f"{real:.6g}{imaginary:+.6g}i" if real else f"{imaginary:.6g}i"
