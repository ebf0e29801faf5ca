"""The paper's equations as it prints them, mass by mass, in NumPy, for real and complex numbers."""

import numpy as np


def hat(a):
    """The antisymmetric matrix of a ×."""
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


def rotation(q):
    """Λ of a versor, ``eq_versor_rot``: the vector part of q v q*, in its homogeneous form for |q| = 1."""
    w, v = q[0], q[1:]
    return np.eye(3) + 2 * w * hat(v) + 2 * hat(v) @ hat(v)


def ball_angular_acceleration(m, chi, chidot, chiddot, inertia, r, g, Omega, Gamma, Ftilde):
    """Ω̇ of ``uncon_ball_eqns_explicit_1d``, with χ̇ = θ̇ζ′ and χ̈ = θ̇²ζ″ + θ̈ζ′."""
    I = np.diag(inertia)
    matrix = -I + 0 * r
    right = np.cross(Omega, I @ Omega) + r * np.cross(Ftilde, Gamma)
    for m_i, x, v, a in zip(m, chi, chidot, chiddot, strict=True):
        s = r * Gamma + x
        matrix = matrix + m_i * hat(s) @ hat(s)
        right = right + m_i * np.cross(s, g * Gamma + np.cross(Omega, np.cross(Omega, x) + 2 * v) + a)
    return np.linalg.solve(matrix, right)


def static_angular_acceleration(m0, chi0, inertia, r, g, Omega, Gamma, Ftilde):
    """Ω̇ of ``uncon_ball_eqns_static2``: a ball with static internal structure."""
    I, s = np.diag(inertia), r * Gamma + chi0
    right = np.cross(Omega, I @ Omega) + r * np.cross(Ftilde, Gamma)
    right = right + m0 * np.cross(s, g * Gamma + np.cross(Omega, np.cross(Omega, chi0)))
    return np.linalg.solve(m0 * hat(s) @ hat(s) - I, right)


def disk_angular_acceleration(m, zeta, zetadot, zetaddot, d2, r, g, phi, phidot, force):
    """φ̈ of ``eqmo_chap_disk_4`` with K_i of ``eq_K_i``; ``force`` is the force along e1."""
    s, c = np.sin(phi), np.cos(phi)
    numerator, denominator = -r * force, d2
    for m_i, x, v, a in zip(m, zeta, zetadot, zetaddot, strict=True):
        K = (
            (g + r * phidot**2) * (x[2] * s - x[0] * c)
            + (r * c + x[2]) * (-2 * phidot * v[2] + a[0])
            - (r * s + x[0]) * (2 * phidot * v[0] + a[2])
        )
        numerator = numerator + m_i * K
        denominator = denominator + m_i * ((r * s + x[0]) ** 2 + (r * c + x[2]) ** 2)
    return numerator / denominator


def newton_disk_acceleration(m0, m1, d2, r, r1, g, phi, phidot, theta, thetadot, thetaddot, force):
    """φ̈ of a disk with one mass on a concentric circle by Newton's laws, ``eq:srd_newton2``."""
    s, c = np.sin(phi + theta), np.cos(phi + theta)
    push = m1 * r1 * (c * (r * (phidot + thetadot) ** 2 + g) + (r1 + r * s) * thetaddot)
    return -(r * force + push) / (d2 + (m0 + m1) * r**2 + m1 * r1 * (r1 + 2 * r * s))


def frisvad_frame(azimuth, elevation):
    """[n, b2, −b1] of section 5, away from the south pole."""
    n = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    a = 1 / (1 + n[2])
    b = -n[0] * n[1] * a
    b1 = np.array([1 - n[0] ** 2 * a, b, -n[0]])
    b2 = np.array([b, 1 - n[1] ** 2 * a, -n[1]])
    return np.stack([n, b2, -b1], axis=1)


def driven_ball_field(x, parameters, u):
    """ẋ of ``rolling_ball_ode_f``, x = (θ, θ̇, q, Ω, z), with the masses on ellipses and θ̈ = ``u``.

    ``parameters`` holds m (n + 1), d (3), r, g, ζ_0 (3), semi-axes (n, 2), frames (n, 3, 3).
    """
    m, d, r, g, chi0, axes, frames = parameters
    n = len(u)
    theta, thetadot, q, Omega = x[:n], x[n : 2 * n], x[2 * n : 2 * n + 4], x[2 * n + 4 : 2 * n + 7]
    chi, chidot, chiddot = [chi0], [0 * chi0], [0 * chi0]
    for k in range(n):
        (a, b), B, s, c = axes[k], frames[k], np.sin(theta[k]), np.cos(theta[k])
        zeta, slope = a * c * B[:, 0] + b * s * B[:, 2], -a * s * B[:, 0] + b * c * B[:, 2]
        chi.append(zeta)
        chidot.append(thetadot[k] * slope)
        chiddot.append(-(thetadot[k] ** 2) * zeta + u[k] * slope)
    Lambda = rotation(q)
    w, v = q[0], q[1:]
    qdot = 0.5 * np.concatenate([[-(v @ Omega)], w * Omega + np.cross(v, Omega)])
    Omegadot = ball_angular_acceleration(m, chi, chidot, chiddot, d, r, g, Omega, Lambda[2], 0 * Omega)
    omega = Lambda @ Omega
    return np.concatenate([thetadot, u, qdot, Omegadot, [r * omega[1], -r * omega[0]]])
