"""Compiled variable projection for one damped oscillation with an offset.

The model of a record of n samples is, with the time tau = i / n in units of the span,

    y_i = exp(-s tau) (a cos(w tau) + b sin(w tau)) + offset

s and w are the decay and the angle over the whole span. Everything that Gauss-Newton needs
are the moments of the five columns (e cos, e sin, 1, tau e cos, tau e sin) with each other and
with y: one pass over the samples for each step, whatever the number of parameters.
Golub and Pereyra 1973; the step is Kaufman's.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = [
    'autocorrelations',
    'curvature',
    'gauss_newton',
    'information',
    'invert',
    'moments',
    'project',
    'residuals',
    'strongest_line',
]

Array = NDArray[np.float64]
Spectrum = NDArray[np.complex128]
FAST = {'reassoc', 'contract'}  # sums may be vectorised; NaN and inf keep their meaning

PREDICTED_GAIN = 1e-8  # stop when a step would gain less than this share of one residual²
ROUNDING = 1e-15  # ... or what an error of so much in the angle would: the limit of float64
MAX_ITERATIONS = 60
MOST_GROWTH = -3.0  # s below this (growing by exp(3) over the span) is no free vibration
MOST_DECAY = 1.0  # s over n above this (exp(-1) a sample) leaves nothing to see


@njit(cache=True)  # type: ignore[untyped-decorator]
def _fill_columns(s: float, w: float, c: Array, q: Array) -> None:
    """exp(-s i/n) cos(w i/n) and sin into c and q, by doubling: rounding grows as log n."""
    n = c.size
    c[0] = 1.0
    q[0] = 0.0
    m = 1
    while m < n:
        e = math.exp(-s * m / n)
        rotation_re = e * math.cos(w * m / n)
        rotation_im = e * math.sin(w * m / n)
        for i in range(min(m, n - m)):
            c[m + i] = c[i] * rotation_re - q[i] * rotation_im
            q[m + i] = c[i] * rotation_im + q[i] * rotation_re
        m *= 2


@njit(cache=True, fastmath=FAST)  # type: ignore[untyped-decorator]
def moments(y: Array, s: float, w: float, c: Array, q: Array, g: Array, h: Array) -> None:
    """Fill g (5, 5) with the columns' products and h (5,) with their products with y.

    c and q are work arrays of y's size.
    """
    n = y.size
    _fill_columns(s, w, c, q)
    s_c = s_q = s_cc = s_cq = s_qq = 0.0
    t_c = t_q = t_cc = t_cq = t_qq = 0.0
    tt_cc = tt_cq = tt_qq = 0.0
    y_1 = y_c = y_q = y_tc = y_tq = 0.0
    step = 1.0 / n
    for i in range(n):
        t = i * step
        ci = c[i]
        qi = q[i]
        yi = y[i]
        tc = t * ci
        tq = t * qi
        s_c += ci
        s_q += qi
        s_cc += ci * ci
        s_cq += ci * qi
        s_qq += qi * qi
        t_c += tc
        t_q += tq
        t_cc += tc * ci
        t_cq += tc * qi
        t_qq += tq * qi
        tt_cc += tc * tc
        tt_cq += tc * tq
        tt_qq += tq * tq
        y_1 += yi
        y_c += yi * ci
        y_q += yi * qi
        y_tc += yi * tc
        y_tq += yi * tq
    g[0, 0], g[0, 1], g[0, 2], g[0, 3], g[0, 4] = s_cc, s_cq, s_c, t_cc, t_cq
    g[1, 1], g[1, 2], g[1, 3], g[1, 4] = s_qq, s_q, t_cq, t_qq
    g[2, 2], g[2, 3], g[2, 4] = n, t_c, t_q
    g[3, 3], g[3, 4], g[4, 4] = tt_cc, tt_cq, tt_qq
    for i in range(1, 5):
        for j in range(i):
            g[i, j] = g[j, i]
    h[0], h[1], h[2], h[3], h[4] = y_c, y_q, y_1, y_tc, y_tq


@njit(cache=True)  # type: ignore[untyped-decorator]
def project(g: Array, h: Array, linear: Array, gradient: Array, hessian: Array) -> bool:
    """Solve for the linear parameters; fill gradient (2,) and hessian (2, 2) of s and w.

    ``gradient`` is J' r, ``hessian`` J' P J with P the projection off the linear columns.
    False where the linear columns are not independent.
    """
    # Cholesky of the leading 3 x 3, with the two last columns and h as right-hand sides.
    l00 = g[0, 0]
    if l00 <= 0.0:
        return False
    l00 = math.sqrt(l00)
    l10 = g[1, 0] / l00
    l20 = g[2, 0] / l00
    l11 = g[1, 1] - l10 * l10
    if l11 <= 1e-14 * g[1, 1]:
        return False
    l11 = math.sqrt(l11)
    l21 = (g[2, 1] - l20 * l10) / l11
    l22 = g[2, 2] - l20 * l20 - l21 * l21
    if l22 <= 1e-14 * g[2, 2]:
        return False
    l22 = math.sqrt(l22)
    v = np.empty((3, 3))  # columns: tau e cos, tau e sin, y in the orthonormal basis
    for k in range(3):
        if k < 2:
            x0, x1, x2 = g[0, 3 + k], g[1, 3 + k], g[2, 3 + k]
        else:
            x0, x1, x2 = h[0], h[1], h[2]
        v[0, k] = x0 / l00
        v[1, k] = (x1 - l10 * v[0, k]) / l11
        v[2, k] = (x2 - l20 * v[0, k] - l21 * v[1, k]) / l22
    linear[2] = v[2, 2] / l22
    linear[1] = (v[1, 2] - l21 * linear[2]) / l11
    linear[0] = (v[0, 2] - l10 * linear[1] - l20 * linear[2]) / l00
    a, b = linear[0], linear[1]
    s_cc = g[3, 3] - (v[0, 0] ** 2 + v[1, 0] ** 2 + v[2, 0] ** 2)
    s_cq = g[3, 4] - (v[0, 0] * v[0, 1] + v[1, 0] * v[1, 1] + v[2, 0] * v[2, 1])
    s_qq = g[4, 4] - (v[0, 1] ** 2 + v[1, 1] ** 2 + v[2, 1] ** 2)
    u_c = h[3] - g[3, 0] * a - g[3, 1] * b - g[3, 2] * linear[2]
    u_q = h[4] - g[4, 0] * a - g[4, 1] * b - g[4, 2] * linear[2]
    gradient[0] = -(a * u_c + b * u_q)
    gradient[1] = b * u_c - a * u_q
    hessian[0, 0] = a * a * s_cc + 2.0 * a * b * s_cq + b * b * s_qq
    hessian[1, 1] = b * b * s_cc - 2.0 * a * b * s_cq + a * a * s_qq
    hessian[0, 1] = -a * b * s_cc + (a * a - b * b) * s_cq + a * b * s_qq
    hessian[1, 0] = hessian[0, 1]
    return True


@njit(cache=True)  # type: ignore[untyped-decorator]
def gauss_newton(
    y: Array, s: float, w: float, c: Array, q: Array, g: Array, h: Array, linear: Array
) -> tuple[float, float, int]:
    """Least squares from the start (s, w); returns s, w, iterations (negative: it failed).

    y must have its mean near zero. On return g, h and linear (a, b, offset) belong to (s, w).
    """
    n = y.size
    energy = 0.0
    for i in range(n):
        energy += y[i] * y[i]
    gradient = np.empty(2)
    hessian = np.empty((2, 2))
    moments(y, s, w, c, q, g, h)
    if not project(g, h, linear, gradient, hessian):
        return s, w, -1
    rss = energy - (h[0] * linear[0] + h[1] * linear[1] + h[2] * linear[2])
    for iteration in range(1, MAX_ITERATIONS + 1):
        det = hessian[0, 0] * hessian[1, 1] - hessian[0, 1] ** 2
        if not det > 1e-20 * hessian[0, 0] * hessian[1, 1]:
            return s, w, -iteration
        d_s = (hessian[1, 1] * gradient[0] - hessian[0, 1] * gradient[1]) / det
        d_w = (hessian[0, 0] * gradient[1] - hessian[0, 1] * gradient[0]) / det
        gain = gradient[0] * d_s + gradient[1] * d_w
        if gain <= PREDICTED_GAIN * max(rss, 0.0) / n + (ROUNDING * (1.0 + w)) ** 2 * energy:
            return s, w, iteration
        # A step beyond these leaves the region in which the linearisation means anything.
        shrink = min(1.0, (1.0 + 0.5 * abs(s)) / max(abs(d_s), 1e-300))
        shrink = min(shrink, (1.0 + 0.5 * abs(s)) / max(abs(d_w), 1e-300))
        improved = False
        for _ in range(30):
            new_s = min(max(s + shrink * d_s, MOST_GROWTH), MOST_DECAY * n)
            new_w = w + shrink * d_w
            if 0.0 < new_w < math.pi * n:
                moments(y, new_s, new_w, c, q, g, h)
                if project(g, h, linear, gradient, hessian):
                    new_rss = energy - (h[0] * linear[0] + h[1] * linear[1] + h[2] * linear[2])
                    if new_rss <= rss + 1e-15 * energy:
                        improved = True
                        break
            shrink *= 0.5
        if not improved:
            moments(y, s, w, c, q, g, h)
            project(g, h, linear, gradient, hessian)
            # No descent left at all: the minimum to rounding if the gain is that small.
            return s, w, iteration if gain <= 1e-9 * energy else -iteration
        s, w, rss = new_s, new_w, new_rss
    return s, w, -MAX_ITERATIONS


@njit(cache=True, fastmath=FAST)  # type: ignore[untyped-decorator]
def _half_ratio(y: Array, length: int, w: float) -> tuple[float, float]:
    """(s, w) refined: the second half of the first ``length`` samples over the first half.

    Both halves' Fourier sums at one angle differ by the pole's decay and turn over half of it.
    """
    n = y.size
    half = length // 2
    turn_re = math.cos(w / n)
    turn_im = math.sin(w / n)
    re = 1.0
    im = 0.0
    first_re = first_im = second_re = second_im = 0.0
    for i in range(half):
        first_re += y[i] * re
        first_im -= y[i] * im
        second_re += y[i + half] * re
        second_im -= y[i + half] * im
        re, im = re * turn_re - im * turn_im, re * turn_im + im * turn_re
    power = first_re**2 + first_im**2
    other = second_re**2 + second_im**2
    if power <= 0.0 or other <= 0.0:
        return 3.0 * n / length, w
    real = first_re * second_re + first_im * second_im
    imaginary = first_re * second_im - first_im * second_re
    turned = math.atan2(imaginary, real) - w * half / n
    turned -= 2.0 * math.pi * math.floor(turned / (2.0 * math.pi) + 0.5)
    s = -0.5 * math.log(other / power) * n / half
    s = min(max(s, 0.0), 4.0 * n / half)
    return s, w + turned * n / half


@njit(cache=True)  # type: ignore[untyped-decorator]
def strongest_line(y: Array, length: int, spectrum: Spectrum) -> tuple[float, float]:
    """(s, w) of the strongest line in the first ``length`` samples.

    ``spectrum`` is the real FFT of those samples, zero-padded to a power of two.
    """
    padded = 2 * (spectrum.size - 1)
    best = -1.0
    peak = 1
    first = max(1, padded // (2 * length))  # half a period in the window: offset, not a line
    for k in range(first, spectrum.size - 1):
        power = spectrum[k].real ** 2 + spectrum[k].imag ** 2
        if power > best:
            best = power
            peak = k
    s, w = _half_ratio(y, length, 2.0 * math.pi * peak * y.size / padded)
    return s, w


@njit(cache=True)  # type: ignore[untyped-decorator]
def residuals(y: Array, s: float, w: float, linear: Array, c: Array, q: Array, r: Array) -> float:
    """Fill r with y minus the model; return the sum of its squares."""
    _fill_columns(s, w, c, q)
    rss = 0.0
    for i in range(y.size):
        r[i] = y[i] - (linear[0] * c[i] + linear[1] * q[i] + linear[2])
        rss += r[i] * r[i]
    return rss


@njit(cache=True)  # type: ignore[untyped-decorator]
def information(g: Array, linear: Array) -> Array:
    """J' J of (s, w, a, b, offset), shape (5, 5), from the columns' products."""
    j = np.zeros((5, 5))
    a, b = linear[0], linear[1]
    j[3, 0], j[4, 0] = -a, -b
    j[3, 1], j[4, 1] = b, -a
    j[0, 2] = j[1, 3] = j[2, 4] = 1.0
    out = np.zeros((5, 5))
    for i in range(5):
        for k in range(5):
            total = 0.0
            for m in range(5):
                for p in range(5):
                    total += j[m, i] * g[m, p] * j[p, k]
            out[i, k] = total
    return out


@njit(cache=True, fastmath=FAST)  # type: ignore[untyped-decorator]
def curvature(r: Array, linear: Array, c: Array, q: Array) -> Array:
    """Sum of r times the model's second derivatives in (s, w, a, b, offset), shape (5, 5).

    c and q must hold the columns, as :func:`residuals` leaves them.
    """
    r_c = r_q = r_tc = r_tq = 0.0
    step = 1.0 / r.size
    for i in range(r.size):
        weighted = r[i] * i * step
        r_c += weighted * c[i]
        r_q += weighted * q[i]
        r_tc += weighted * i * step * c[i]
        r_tq += weighted * i * step * q[i]
    a, b = linear[0], linear[1]
    out = np.zeros((5, 5))
    out[0, 0] = a * r_tc + b * r_tq
    out[1, 1] = -out[0, 0]
    out[0, 1] = out[1, 0] = a * r_tq - b * r_tc
    out[0, 2] = out[2, 0] = -r_c
    out[0, 3] = out[3, 0] = -r_q
    out[1, 2] = out[2, 1] = -r_q
    out[1, 3] = out[3, 1] = r_c
    return out


@njit(cache=True)  # type: ignore[untyped-decorator]
def invert(matrix: Array, out: Array) -> bool:
    """Inverse of a symmetric positive definite matrix by Cholesky; False if it is not one."""
    n = matrix.shape[0]
    factor = np.zeros((n, n))  # inverse of the lower triangle, column by column
    lower = np.zeros((n, n))
    for i in range(n):
        for k in range(i + 1):
            total = matrix[i, k]
            for m in range(k):
                total -= lower[i, m] * lower[k, m]
            if i == k:
                if not total > 1e-14 * matrix[i, i]:
                    return False
                lower[i, i] = math.sqrt(total)
            else:
                lower[i, k] = total / lower[k, k]
    for k in range(n):
        factor[k, k] = 1.0 / lower[k, k]
        for i in range(k + 1, n):
            total = 0.0
            for m in range(k, i):
                total -= lower[i, m] * factor[m, k]
            factor[i, k] = total / lower[i, i]
    for i in range(n):
        for k in range(i + 1):
            total = 0.0
            for m in range(i, n):
                total += factor[m, i] * factor[m, k]
            out[i, k] = out[k, i] = total
    return True


@njit(cache=True, fastmath=FAST)  # type: ignore[untyped-decorator]
def autocorrelations(r: Array, lags: int) -> Array:
    """Autocorrelation of r at lags 1 ... lags, shape (lags,); r is taken to have no mean."""
    out = np.zeros(lags)
    power = 0.0
    for i in range(r.size):
        power += r[i] * r[i]
    if power > 0.0:
        for lag in range(1, lags + 1):
            total = 0.0
            for i in range(r.size - lag):
                total += r[i] * r[i + lag]
            out[lag - 1] = total / power
    return out
