"""The formats of numbers in tables and sentences."""


def seconds(time: float) -> str:
    """A time with three digits in a suitable unit."""
    for unit, size in (("s", 1.0), ("ms", 1e-3)):
        if time >= size:
            return f"{time / size:.3g} {unit}"
    return f"{time / 1e-6:.3g} μs"


def power(x: float, digits: int = 1) -> str:
    """``x`` with an exponent without leading zeros: 1e-8."""
    mantissa, _, exponent = f"{x:.{digits - 1}e}".partition("e")
    return f"{mantissa}e{int(exponent)}"
