"""What else estimates velocity and friction from drive and encoder, for `observer.py`.

Every estimator is ``step(p, s, u, y, o)``, compiled: numbers p of the nominal axis (places below,
its own from OWN on), memory s, drive u over the past sample, new reading y, and what it states
o: position, velocity, friction while sliding, mode.  All use the reading of their own sample.
Nothing here imports the package.

Sources: disturbance observer, Ohnishi 1987; robust exact differentiator, Levant 2003
(doi 10.1080/0020717031000099029); LuGre, Canudas de Wit et al. 1995 (doi 10.1109/9.376053);
interacting multiple models, Blom and Bar-Shalom 1988 (doi 10.1109/9.1299).
"""

from __future__ import annotations

import math

import numpy as np
import scipy.linalg
from numba import njit

#: Places of the nominal axis: sampling time, mass, viscous coefficient, increment, travel,
#: Coulomb level over position (four coefficients a direction), band of rest, own numbers.
DT, M, FV, Q, LO, HI, CP, CM, BAND, OWN = 0, 1, 2, 3, 4, 5, 6, 10, 14, 15
SIZE, MEMORY = 32, 96


@njit
def level(p, y, s):
    """Coulomb level in direction s at a reading."""
    x = min(max(y, p[LO]), p[HI])
    b = CP if s > 0 else CM
    return p[b] + x * (p[b + 1] + x * (p[b + 2] + x * p[b + 3]))


@njit
def sgn(x):
    """Sign, 0 at 0."""
    return 1.0 if x > 0 else (-1.0 if x < 0 else 0.0)


@njit
def bandmode(p, v):
    """Mode by a band of velocity."""
    return 0.0 if abs(v) <= p[BAND] else sgn(v)


@njit
def fd(p, s, u, y, o):
    """Filtered difference; own: time constant."""
    keep = math.exp(-p[DT] / p[OWN])
    vb = s[1]
    s[1] = keep * s[1] + (1 - keep) * (y - s[0]) / p[DT]
    s[2] = keep * s[2] + (1 - keep) * (s[1] - vb) / p[DT]
    s[0] = y
    o[0], o[1], o[2], o[3] = y, s[1], u - p[M] * s[2] - p[FV] * s[1], bandmode(p, s[1])


@njit
def kf(p, s, u, y, o):
    """Kalman filter or extended state observer: own a12, a22, e1, e2 and three gains."""
    F = u + s[2]
    x = s[0] + p[OWN] * s[1] + p[OWN + 2] * F
    v = p[OWN + 1] * s[1] + p[OWN + 3] * F
    e = y - x
    s[0], s[1], s[2] = x + p[OWN + 4] * e, v + p[OWN + 5] * e, s[2] + p[OWN + 6] * e
    o[0], o[1], o[2], o[3] = s[0], s[1], -s[2], bandmode(p, s[1])


@njit
def lp2(s, i, w, dt, r):
    """Second-order low-pass, exact for zeta=1/sqrt2 and held input; returns y, y', y''."""
    z = math.sqrt(0.5)
    a, b = z * w, w * math.sqrt(1 - z * z)
    e, c, d = math.exp(-a * dt), math.cos(b * dt), math.sin(b * dt)
    x, v = s[i] - r, s[i + 1]
    xn = e * (x * c + (v + a * x) / b * d)
    vn = e * (v * c - (a * v + w * w * x) / b * d)
    s[i], s[i + 1] = xn + r, vn
    return s[i], s[i + 1], -w * w * xn - 2 * z * w * vn


@njit
def dob(p, s, u, y, o):
    """Disturbance observer: own bandwidths for friction and velocity."""
    _, v1, a1 = lp2(s, 0, p[OWN], p[DT], y)
    uf, _, _ = lp2(s, 2, p[OWN], p[DT], u)
    x2, v2, _ = lp2(s, 4, p[OWN + 1], p[DT], y)
    o[0], o[1], o[2], o[3] = y, v2, uf - p[M] * a1 - p[FV] * v1, bandmode(p, v2)


@njit
def levant(p, s, u, y, o):
    """Robust exact differentiator; own: L, filter times of friction and velocity."""
    dt, L = p[DT], p[OWN]
    n = 4
    h = dt / n
    for _ in range(n):
        e = s[0] - y
        a = abs(e)
        d0 = -2.0 * L ** (1 / 3) * a ** (2 / 3) * sgn(e) + s[1]
        d1 = -2.12 * L ** (2 / 3) * a ** (1 / 3) * sgn(e) + s[2]
        d2 = -1.1 * L * sgn(e)
        s[0] += h * d0 + 0.5 * h * h * s[2]
        s[1] += h * d1
        s[2] += h * d2
    kF, kV = math.exp(-dt / p[OWN + 1]), math.exp(-dt / p[OWN + 2])
    s[3] = kF * s[3] + (1 - kF) * (u - p[M] * s[2] - p[FV] * s[1])
    s[4] = kV * s[4] + (1 - kV) * s[1]
    o[0], o[1], o[2], o[3] = s[0], s[4], s[3], bandmode(p, s[4])


@njit
def lugre_map(p, x, v, z, d, u, y):
    """LuGre model one sample on; z is the friction of the bristles."""
    n = 4
    h = p[DT] / n
    for _ in range(n):
        sv = 1.0 if v > 0 else -1.0
        g = max(level(p, y, sv) + d, 0.05 * level(p, y, sv))
        s0 = level(p, y, sv) / p[OWN]
        # z is in force units: z' = s0 v - s0 |v| z / g, exact for held v
        lam = s0 * abs(v) / g
        zs = sv * g
        zn = zs + (z - zs) * math.exp(-lam * h)
        F = 0.5 * (z + zn)
        damp = p[FV] / p[M] + h * s0 / p[M] * 0.5
        vn = (v + h * (u - F) / p[M]) / (1 + h * damp)
        x += 0.5 * h * (v + vn)
        v, z = vn, zn
    return x, v, z, d


@njit
def ekf(p, s, u, y, o):
    """Extended Kalman filter on LuGre; own: presliding distance, force, level, reading noise."""
    P = s[16:32].reshape(4, 4)
    Fc = level(p, y, 1.0)
    if s[9] == 0.0:
        s[9] = 1.0
        s[0] = y
        P[0, 0] = p[Q] ** 2
        P[1, 1] = (10 * p[Q] / p[DT]) ** 2
        P[2, 2] = Fc * Fc
        P[3, 3] = (0.2 * Fc) ** 2
    x0, v0, z0, d0 = s[0], s[1], s[2], s[3]
    f = np.empty(4)
    g = np.empty(4)
    A = np.empty((4, 4))
    f[0], f[1], f[2], f[3] = lugre_map(p, x0, v0, z0, d0, u, y)
    step = np.array([p[Q], 0.05 * p[Q] / p[DT] + 1e-3 * abs(v0), 0.01 * Fc, 0.01 * Fc])
    for j in range(4):
        g[0], g[1], g[2], g[3] = lugre_map(
            p,
            x0 + step[j] * (j == 0),
            v0 + step[j] * (j == 1),
            z0 + step[j] * (j == 2),
            d0 + step[j] * (j == 3),
            u,
            y,
        )
        for i in range(4):
            A[i, j] = (g[i] - f[i]) / step[j]
    N = A @ P @ A.T
    N[0, 0] += (0.05 * p[Q]) ** 2
    N[1, 1] += (p[OWN + 1] * Fc / p[M] * p[DT]) ** 2
    N[2, 2] += (p[OWN + 1] * Fc) ** 2
    N[3, 3] += (p[OWN + 2] * Fc) ** 2
    S = N[0, 0] + (p[OWN + 3] * p[Q]) ** 2
    e = y - f[0]
    K = N[:, 0] / S
    for i in range(4):
        s[i] = f[i] + K[i] * e
        for j in range(4):
            P[i, j] = N[i, j] - K[i] * N[0, j]
    for i in range(4):
        for j in range(i):
            m = 0.5 * (P[i, j] + P[j, i])
            P[i, j] = m
            P[j, i] = m
    s[3] = min(max(s[3], -0.6 * Fc), 0.8 * Fc)
    o[0], o[1], o[2], o[3] = s[0], s[1], s[2], bandmode(p, s[1])


@njit
def imm(p, s, u, y, o):
    """Interacting multiple models; own: walk, reading noise, chance to change, rest noise."""
    # s[0:3] mode probabilities (0 stick, 1 plus, 2 minus); means at 8+3i; covs at 20+9i
    dt = p[DT]
    Fc = level(p, y, 1.0)
    ux, uv, uw = p[Q], p[Q] / dt, Fc  # units
    if s[90] == 0.0:
        s[90] = 1.0
        s[0], s[1], s[2] = 0.98, 0.01, 0.01
        for i in range(3):
            s[8 + 3 * i] = y
            for k in range(3):
                s[20 + 9 * i + 4 * k] = (1.0, 1.0, 0.04)[k]
    pe = p[OWN + 2]
    T = np.array(
        [[1 - pe, pe / 2, pe / 2], [pe, 1 - pe * 1.1, pe * 0.1], [pe, pe * 0.1, 1 - pe * 1.1]]
    )
    mu = s[0:3].copy()
    c = T.T @ mu
    m0 = np.empty((3, 3))
    covariances = np.zeros((3, 3, 3))
    for j in range(3):
        for k in range(3):
            m0[j, k] = 0.0
        for i in range(3):
            w = T[i, j] * mu[i] / c[j]
            for k in range(3):
                m0[j, k] += w * s[8 + 3 * i + k]
        for i in range(3):
            w = T[i, j] * mu[i] / c[j]
            d0 = (s[8 + 3 * i] - m0[j, 0]) / ux
            d1 = (s[8 + 3 * i + 1] - m0[j, 1]) / uv
            d2 = (s[8 + 3 * i + 2] - m0[j, 2]) / uw
            for a in range(3):
                da = (d0, d1, d2)[a]
                for b in range(3):
                    db = (d0, d1, d2)[b]
                    covariances[j, a, b] += w * (s[20 + 9 * i + 3 * a + b] + da * db)
    af = p[FV] / p[M]
    tot = 0.0
    A = np.zeros((3, 3))
    for j in range(3):
        x, v, w = m0[j, 0], m0[j, 1], m0[j, 2]
        P = covariances[j]
        A[:, :] = 0.0
        A[0, 0] = 1.0
        A[2, 2] = 1.0
        if j == 0:
            xn, vn, wn = x, 0.0, w
            q0, q1 = p[OWN + 3] ** 2, (p[OWN + 3]) ** 2
        else:
            si = 1.0 if j == 1 else -1.0
            acc = (u - si * level(p, y, si) + w - p[FV] * v) / p[M]
            xn, vn, wn = x + dt * v + 0.5 * dt * dt * acc, v + dt * acc, w
            A[0, 1] = 1.0
            A[1, 1] = 1 - dt * af
            A[0, 2] = 0.5 * dt * dt / p[M] * uw / ux
            A[1, 2] = dt / p[M] * uw / uv
            q0, q1 = 0.0, 0.0
        N = A @ P @ A.T
        N[0, 0] += q0 + 1e-6
        N[1, 1] += q1 + 1e-6
        N[2, 2] += p[OWN] ** 2
        S = N[0, 0] + p[OWN + 1] ** 2
        e = (y - xn) / ux
        lik = math.exp(-0.5 * min(e * e / S, 600.0)) / math.sqrt(S)
        K0, K1, K2 = N[0, 0] / S, N[1, 0] / S, N[2, 0] / S
        s[8 + 3 * j], s[9 + 3 * j], s[10 + 3 * j] = (
            xn + K0 * e * ux,
            vn + K1 * e * uv,
            wn + K2 * e * uw,
        )
        for a in range(3):
            Ka = (K0, K1, K2)[a]
            for b in range(3):
                s[20 + 9 * j + 3 * a + b] = N[a, b] - Ka * N[0, b]
        s[j] = c[j] * lik + 1e-12
        tot += s[j]
    x = v = 0.0
    for j in range(3):
        s[j] = max(s[j] / tot, 1e-6)
        x += s[j] * s[8 + 3 * j]
        v += s[j] * s[9 + 3 * j]
    b = 0
    if s[1] > s[b]:
        b = 1
    if s[2] > s[b]:
        b = 2
    k = 1 if s[1] >= s[2] else 2
    si = 1.0 if k == 1 else -1.0
    o[0], o[1], o[2] = x, v, si * level(p, y, si) - s[10 + 3 * k]
    o[3] = 0.0 if b == 0 else si


@njit
def run(kind, p, u, y, out):
    """A whole record by the estimator of a kind: rows position, velocity, friction, mode."""
    s = np.zeros(MEMORY)
    s[0] = y[0]
    if kind == 2:
        s[4] = y[0]
    o = np.zeros(4)
    for k in range(u.shape[0]):
        before = u[k - 1] if k else 0.0
        if kind == 0:
            fd(p, s, before, y[k], o)
        elif kind == 1:
            kf(p, s, before, y[k], o)
        elif kind == 2:
            dob(p, s, before, y[k], o)
        elif kind == 3:
            levant(p, s, before, y[k], o)
        elif kind == 4:
            ekf(p, s, before, y[k], o)
        else:
            imm(p, s, before, y[k], o)
        out[0, k], out[1, k], out[3, k] = o[0], o[1], o[3]
        out[2, k] = u[k] if o[3] == 0.0 else o[2]


#: Kinds in the order of `run`.
KINDS = ("difference", "linear", "disturbance", "levant", "lugre", "imm")


def estimates(kind, axis, dt, quantum, band, own, u, y):
    """Rows position, velocity, friction, mode of an estimator on a nominal axis.

    `band` is the velocity below which it states rest, `own` its own numbers.
    """
    p, out = np.zeros(SIZE), np.empty((4, u.size))
    p[[DT, M, FV, Q, BAND]] = dt, axis.mass, axis.viscous, quantum, band
    p[[LO, HI]] = axis.travel or (-1e9, 1e9)
    for place, levels in ((CP, axis.coulomb.plus), (CM, axis.coulomb.minus)):
        p[place : place + len(levels)] = levels
    p[OWN : OWN + len(own)] = own
    with np.errstate(all="ignore"):
        run(KINDS.index(kind), p, np.ascontiguousarray(u), np.ascontiguousarray(y), out)
    return np.nan_to_num(out, nan=1e9, posinf=1e9, neginf=-1e9)


def linear(axis, dt, gains):
    """Numbers of kind "linear": the exactly sampled sliding mode, and gains of its correction."""
    rate = axis.viscous / axis.mass
    fade = math.exp(-rate * dt)
    a12 = -math.expm1(-rate * dt) / rate
    return a12, fade, (dt - a12) / axis.viscous, a12 / axis.mass, *gains


def kalman(axis, dt, quantum, walk):
    """The same for a stationary Kalman filter: rounding by `quantum` [m], `walk` [N/sample]."""
    noise = quantum / math.sqrt(12.0)
    a12, a22, e1, e2 = linear(axis, dt, ())
    # Scaled, as in SI units the Riccati equation is badly conditioned.
    unit = np.array([noise, noise / dt, noise / dt**2 * axis.mass])
    scaled = np.array([[1.0, a12, e1], [0.0, a22, e2], [0.0, 0.0, 1.0]]) * unit / unit[:, None]
    noises = np.diag([0.0, 0.0, (walk / unit[2]) ** 2])
    P = scipy.linalg.solve_discrete_are(scaled.T, np.eye(3)[:, :1], noises, np.eye(1))
    return a12, a22, e1, e2, *(P[:, 0] / (P[0, 0] + 1.0) * unit / unit[0])
