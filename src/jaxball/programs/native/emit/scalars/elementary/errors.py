"""The error function and its complement.

Source: FDLIBM (Sun Microsystems, 1993), s_erf.c, for the intervals and the coefficients of the rational functions.
"""

from .exponentials import exp_of_pair
from .writer import Writer, clamp

_NEAR, _FAR, _FARTHEST = 0.84375, 1.25, 1 / 0.35  # where intervals end
_AT_1 = 8.45062911510467529297e-01  # about erf 1

# (erf x − x)/x as P/Q of x², below _NEAR.
_P_NEAR = (
    1.28379167095512558561e-01,
    -3.25042107247001499370e-01,
    -2.84817495755985104766e-02,
    -5.77027029648944159157e-03,
    -2.37630166566501626084e-05,
)
_Q_NEAR = (
    1.0,
    3.97917223959155352819e-01,
    6.50222499887672944485e-02,
    5.08130628187576562776e-03,
    1.32494738004321644526e-04,
    -3.96022827877536812320e-06,
)
# erf x − _AT_1 as P/Q of x − 1, below _FAR.
_P_MIDDLE = (
    -2.36211856075265944077e-03,
    4.14856118683748331666e-01,
    -3.72207876035701323847e-01,
    3.18346619901161753674e-01,
    -1.10894694282396677476e-01,
    3.54783043256182359371e-02,
    -2.16637559486879084300e-03,
)
_Q_MIDDLE = (
    1.0,
    1.06420880400844228286e-01,
    5.40397917702171048937e-01,
    7.18286544141962662868e-02,
    1.26171219808761642112e-01,
    1.36370839120290507362e-02,
    1.19844998467991074170e-02,
)
# log(x erfc x) + x² + 0.5625 as P/Q of 1/x², below _FARTHEST and beyond.
_P_FAR = (
    -9.86494403484714822705e-03,
    -6.93858572707181764372e-01,
    -1.05586262253232909814e01,
    -6.23753324503260060396e01,
    -1.62396669462573470355e02,
    -1.84605092906711035994e02,
    -8.12874355063065934246e01,
    -9.81432934416914548592e00,
)
_Q_FAR = (
    1.0,
    1.96512716674392571292e01,
    1.37657754143519042600e02,
    4.34565877475229228821e02,
    6.45387271733267880336e02,
    4.29008140027567833386e02,
    1.08635005541779435134e02,
    6.57024977031928170135e00,
    -6.04244152148580987438e-02,
)
_P_FARTHEST = (
    -9.86494292470009928597e-03,
    -7.99283237680523006574e-01,
    -1.77579549177547519889e01,
    -1.60636384855821916062e02,
    -6.37566443368389627722e02,
    -1.02509513161107724954e03,
    -4.83519191608651397019e02,
)
_Q_FARTHEST = (
    1.0,
    3.03380607434824582924e01,
    3.25792512996573918826e02,
    1.53672958608443695994e03,
    3.19985821950859553908e03,
    2.55305040643316442583e03,
    4.74528541206955367215e02,
    -2.24409524465858183362e01,
)


def _parts(w: Writer, x: str) -> tuple[str, str, str, str]:
    """Computes whether |x| < _NEAR and |x| < _FAR, the rational function of x's interval, and erfc |x| beyond _FAR."""
    size = w.call("fabs", x)
    near, middle = w.compare("olt", size, _NEAR), w.compare("olt", size, _FAR)
    far = clamp(w, size, 1.0, 30.0)
    square, rest = w.product(far, far)
    inverse = w.div(1.0, square)
    intervals = [
        (w.compare("olt", size, _FARTHEST), inverse, _P_FAR, _Q_FAR),
        (middle, w.sub(size, 1.0), _P_MIDDLE, _Q_MIDDLE),
        (near, w.mul(size, size), _P_NEAR, _Q_NEAR),
    ]
    above, below = w.polynomial(inverse, _P_FARTHEST), w.polynomial(inverse, _Q_FARTHEST)
    for within, argument, p, q in intervals:
        above = w.select(within, w.polynomial(argument, p), above)
        below = w.select(within, w.polynomial(argument, q), below)
    ratio = w.div(above, below)
    power, error = w.sum_of_any(w.neg(square), -0.5625)
    power, more = w.sum_of_any(power, ratio)
    return near, middle, ratio, w.div(exp_of_pair(w, power, w.add(more, w.sub(error, rest))), far)


def erf(w: Writer, operands: list[str]) -> list[str]:
    """Computes it from whichever of the functions of parts of its arguments is meant."""
    (x,) = operands
    near, middle, ratio, far = _parts(w, x)
    result = w.call("copysign", w.select(middle, w.add(_AT_1, ratio), w.sub(1.0, far)), x)
    result = w.select(near, w.fma(x, ratio, x), result)
    return [w.select(w.compare("uno", x, x), x, result)]


def erfc(w: Writer, operands: list[str]) -> list[str]:
    """Computes 1 − erf x where that loses nothing, and its own function beyond 1.25, to 1.5 units of the last place."""
    (x,) = operands
    near, middle, ratio, far = _parts(w, x)
    negative = w.is_negative(x)
    result = w.select(negative, w.sub(2.0, far), far)
    beside = w.select(negative, w.add(1 + _AT_1, ratio), w.sub(1 - _AT_1, ratio))
    result = w.select(middle, beside, result)
    from_half = w.select(w.compare("ogt", x, 0.25), 0.5, 0.0)  # 1/2 − (erf x − 1/2) or 1 − erf x
    beside = w.fma(x, ratio, w.sub(x, from_half))
    result = w.select(near, w.sub(w.sub(1.0, from_half), beside), result)
    return [w.select(w.compare("uno", x, x), x, result)]
