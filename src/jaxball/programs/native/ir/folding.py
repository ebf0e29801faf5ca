"""Constant folding: operations on known numbers, and identities that hold whatever the other number is."""

import operator
from collections.abc import Callable
from typing import Any

import numpy as np

from .elements import Element, is_known

FOLDED: dict[str, Callable[[Any, Any], Any]] = {
    "add": operator.add,
    "sub": operator.sub,
    "mul": operator.mul,
    "and": operator.and_,
    "or": operator.or_,
    "xor": operator.xor,
}
# Numbers that are known have a type, so that the same operator compares signed and unsigned ones.
COMPARED: dict[str, Callable[[Any, Any], Any]] = {
    "eq": operator.eq,
    "ne": operator.ne,
    "slt": operator.lt,
    "sle": operator.le,
    "sgt": operator.gt,
    "sge": operator.ge,
    "ult": operator.lt,
    "ule": operator.le,
    "ugt": operator.gt,
    "uge": operator.ge,
    "oeq": operator.eq,
    "une": operator.ne,
    "olt": operator.lt,
    "ole": operator.le,
    "ogt": operator.gt,
    "oge": operator.ge,
}


def read(dtype: np.dtype, number: str) -> Element:
    """Reads a number as LLVM writes it."""
    if dtype.kind == "b":
        return np.bool_(number == "true")
    if dtype.kind == "f":
        return dtype.type(np.uint64(int(number, 16)).view(np.float64))
    return np.array(int(number)).astype(dtype)[()]


def suffix(dtype: np.dtype) -> str:
    """Returns a type as intrinsics' names have it."""
    return f"{'f' if dtype.kind == 'f' else 'i'}{1 if dtype.kind == 'b' else 8 * dtype.itemsize}"


def simpler_float(operation: str, x: Element, y: Element) -> Element | None:
    """Returns the operand that equals the result whatever the other number is: also for −0, infinities and NaN."""
    # Not x + 0, which is 0 where x is −0, and not 0 x, which is −0 of a negative number, and NaN of an infinite one.
    if operation in ("mul", "div") and is_known(y) and y == 1:
        return x
    if operation == "mul" and is_known(x) and x == 1:
        return y
    if operation == "sub" and is_known(y) and y == 0 and not np.signbit(y):
        return x
    if operation == "add":
        for number, other in ((x, y), (y, x)):
            if is_known(number) and number == 0 and np.signbit(number):
                return other
    return None


def simpler_integer(operation: str, dtype: np.dtype, x: Element, y: Element) -> Element | None:
    for number, other in ((y, x), (x, y)):
        # 0 − y is not y.
        if not is_known(number) or (operation == "sub" and number is x):
            continue
        if number == 0 and operation in ("add", "sub", "or", "xor"):
            return other
        if number == 0 and operation in ("mul", "and"):
            return dtype.type(0)
        if operation == "mul" and number == 1:
            return other
        if dtype.kind == "b" and number and operation in ("and", "or"):
            return other if operation == "and" else np.bool_(True)
    if operation in ("and", "or") and isinstance(x, str) and x == y:
        return x
    return None
