"""Rolling on grounds that move, with resistance and with mechanisms, where the motion is known in closed form.

Solves have tolerances of 1e-12; by how much less than their bounds runs err was measured, mostly a hundredth.
"""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import eigh
from scipy.spatial.transform import Rotation

import jaxball
from jaxball.numerics.arrays import arrays_of

E1, E2, E3 = np.eye(3)
D, M, R, G = 0.6, 1.3, 0.9, 2.0  # a homogeneous ball: its moment of inertia, mass and radius; and gravity
K = D / (M * R**2)
UNBALANCED = {"inertia": (0.5, 0.6, 0.7), "offset": (0.1, -0.05, 0.15)}
COUNT = 21  # of times: as all runs have as many, balls of one structure share a compiled program
TOLERANCE, SHARP = 1e-12, 1e-14
FREQUENCY = 1.7  # at which the ground is shaken


def run(body, state, until, *, tolerance=TOLERANCE, inside=True):
    times = np.linspace(0.0, until, COUNT) if np.ndim(until) == 0 else until
    solved = jaxball.simulate(
        body, times, state, rtol=tolerance, atol=tolerance * 1e-4, step_to_times=True, inside=inside
    )
    return solved.raise_if_failed()


def displacement(t, p):
    """X(t) of the ground, from rest."""
    return p["steady"] * t**2 / 2 + p["swing"] * (1 - jnp.cos(FREQUENCY * t))


def ground(*, steady=(0.0, 0.0, 0.0), swing=(0.0, 0.0, 0.0), W=0.0, wobble=0.0, centre=(0.0, 0.0), **tilt):
    """A ground of one structure, whatever of it is at rest; its turntable has turned by W t + wobble sin 2t."""
    motion = jaxball.Free(displacement, {"steady": jnp.asarray(steady), "swing": jnp.asarray(swing)})
    turning = jaxball.Sinusoids(0.0, amplitude=[wobble], frequency=[2.0], rate=W)
    return jaxball.Ground(motion=motion, turntable=jaxball.Turntable(turning, centre), **tilt)


def body(**changes):
    given = {"mass": M, "inertia": (D, D, D), "radius": R, "gravity": G, "ground": ground()}
    return jaxball.Ball(**{**given, **changes})


def plane(v):
    """A horizontal vector as a complex number, which i turns as e3 × does."""
    return np.asarray(v)[..., 0] + 1j * np.asarray(v)[..., 1]


def rotations(state):
    return Rotation.from_quat(np.roll(state.q, -1, axis=-1)).as_matrix()


def in_space(Lambda, v):
    return np.einsum("tij,tj->ti", Lambda, v)


def spread(values):
    """How far values leave the first of them."""
    return np.max(np.abs(values - values[0]))


class TestHomogeneousBall:
    """z̈ = (g − Ẍ)/(1 + k) + k/(1 + k) u̇ in the plane, with k = d/(M r²)."""

    def plain(self, *, resistance=(0.0, 0.0, 0.0, 0.0), **changes):
        return body(ground=ground(**changes), resistance=jaxball.Resistance(*resistance))

    @pytest.mark.thorough
    def test_rolls_down_an_incline(self):
        a, b = 0.4, 0.7
        done = run(self.plain(angle=a, heading=b), jaxball.BallState(), 3.0)
        along = np.exp(1j * b) * G * np.sin(a) / (1 + K)
        np.testing.assert_allclose(plane(done.state.z), along * done.times**2 / 2, atol=1e-11)
        seen = done.observables
        np.testing.assert_allclose(plane(seen.friction), -np.exp(1j * b) * K / (1 + K) * M * G * np.sin(a), atol=1e-12)
        np.testing.assert_allclose(seen.normal_force, M * G * np.cos(a), atol=1e-12)

    @pytest.mark.thorough
    @pytest.mark.parametrize("angle", [0.0, 0.2])
    def test_circles_and_drifts_on_a_turntable(self, angle):
        """A circle at k/(1 + k) W, whose centre drifts across the slope at e3 × g/(k W)."""
        W, centre, z, Omega = 1.5, (0.3, -0.2), (1.0, 0.4), (0.5, -0.4, 0.8)
        state = jaxball.BallState(Omega=Omega, z=z)
        done = run(self.plain(angle=angle, W=W, centre=centre), state, 12.0)
        rate, pull = K / (1 + K) * W, G * np.sin(angle)
        start = -1j * R * plane(Omega) + 1j * W * (plane(z) - plane(centre))
        drift = 1j * pull / (K * W)
        t = done.times
        expected = plane(z) + drift * t + (start - drift) * (np.exp(1j * rate * t) - 1) / (1j * rate)
        np.testing.assert_allclose(plane(done.state.z), expected, atol=5e-11)

    def test_follows_an_accelerating_turntable(self):
        """Started at k/(1 + k) u, it circles the turntable's centre, by k/(1 + k) of the table's own turning."""
        W, wobble, centre, z = 0.8, 0.3, (0.3, -0.2), (1.0, 0.4)
        arm = plane(z) - plane(centre)
        rolling = (1 / (1 + K)) * (W + 2 * wobble) * arm / R  # ω₁ + i ω₂
        state = jaxball.BallState(Omega=(rolling.real, rolling.imag, 0.5), z=z)
        done = run(self.plain(W=W, wobble=wobble, centre=centre), state, 6.0)
        turned = W * done.times + wobble * np.sin(2 * done.times)
        expected = plane(centre) + arm * np.exp(1j * K / (1 + K) * turned)
        np.testing.assert_allclose(plane(done.state.z), expected, atol=5e-11)

    def test_slows_down_by_viscous_resistance(self):
        """v̇ = g/(1 + k) − λ v with λ = (c_r + c_w + c_v r²)/(d + M r²); ω₃ decays at (c_s + c_w)/d."""
        a, b, Omega = 0.1, 0.7, (0.5, -0.4, 0.8)
        c_r, c_s, c_v, c_w = 0.3, 0.2, 0.5, 0.1
        resisted = self.plain(angle=a, heading=b, resistance=(c_r, c_s, c_v, c_w))
        done = run(resisted, jaxball.BallState(Omega=Omega), 6.0)
        rate = (c_r + c_w + c_v * R**2) / (D + M * R**2)
        start, last = -1j * R * plane(Omega), np.exp(1j * b) * G * np.sin(a) / (1 + K) / rate
        t = done.times
        expected = last * t + (start - last) * (1 - np.exp(-rate * t)) / rate
        np.testing.assert_allclose(plane(done.state.z), expected, atol=1e-11)
        omega = in_space(rotations(done.state), done.state.Omega)
        np.testing.assert_allclose(omega[:, 2], Omega[2] * np.exp(-(c_s + c_w) / D * t), atol=1e-11)

    @pytest.mark.thorough
    def test_lags_behind_a_ground_that_is_shaken(self):
        swing = np.array([0.3, -0.2, 0.1])
        state = jaxball.BallState(Omega=(0.5, -0.4, 0.8))
        done = run(self.plain(swing=swing), state, 6.0)
        t = done.times
        X = swing[None] * (1 - np.cos(FREQUENCY * t))[:, None]
        expected = -1j * R * plane(state.Omega) * t - plane(X) / (1 + K)
        np.testing.assert_allclose(plane(done.state.z), expected, atol=1e-11)
        lifted = M * (G + swing[2] * FREQUENCY**2 * np.cos(FREQUENCY * t))
        np.testing.assert_allclose(done.observables.normal_force, lifted, atol=1e-12)


@pytest.mark.thorough
class TestDryFriction:
    """v̇ = g/(1 + k) − μ g₃/(1 + k) v/√(v² + r²ε²)."""

    def test_slows_the_ball_down_on_level_ground(self):
        """With y = |ω_h|, √(y² + ε²) − ε arsinh(ε/y) falls at μ g/(r (1 + k)), and the ball rolls straight."""
        mu, epsilon, Omega = 0.2, 0.05, (0.6, -0.8, 0.3)
        resisted = body(resistance=jaxball.Resistance(dry=mu, smoothing=epsilon))
        done = run(resisted, jaxball.BallState(Omega=Omega), 3.5)
        omega = in_space(rotations(done.state), done.state.Omega)
        y = np.hypot(omega[:, 0], omega[:, 1])
        assert y[-1] < epsilon < y[0] / 10
        gone = np.hypot(y, epsilon) - epsilon * np.arcsinh(epsilon / y)
        np.testing.assert_allclose(gone[0] - gone, mu * G / (R * (1 + K)) * done.times, atol=1e-11)
        np.testing.assert_allclose(plane(omega) / y, plane(Omega), atol=1e-11)
        np.testing.assert_allclose(omega[:, 2], Omega[2], atol=1e-11)

    def test_smoothed_it_lets_the_ball_creep_on_a_slope(self):
        """At ω = ε s/√(1 − s²), with s = tan a/μ; what is left of the start decays e³⁰ times in this run."""
        mu, epsilon, s = 0.2, 0.05, 0.5
        slope = body(ground=ground(angle=np.arctan(s * mu)), resistance=jaxball.Resistance(dry=mu, smoothing=epsilon))
        done = run(slope, jaxball.BallState(), 8.0)
        speed = R * epsilon * s / np.sqrt(1 - s**2)
        omega = in_space(rotations(done.state), done.state.Omega)
        np.testing.assert_allclose(R * omega[-1, :2], (0.0, speed), atol=1e-11)


class TestSphericalPendulum:
    """In a homogeneous ball, to which it is hinged at the centre, the ball is a sled of mass m₀ + d/r²."""

    m, l = 0.5, 0.6
    sled = M + D / R**2

    def ball(self, **changes):
        return body(mechanisms=[jaxball.spherical_pendulum(self.m, self.l)], **changes)

    def swinging(self, state):
        """Λ, ω, and ρ and ρ̇ from the pivot to the mass, in space; χ and χ̇ in the body."""
        first = Rotation.from_rotvec(np.asarray(state.theta)[:, :1] * E2)
        second = Rotation.from_rotvec(np.asarray(state.theta)[:, 1:] * E1)
        chi = (first * second).apply(-self.l * E3)
        along = np.cross(E2[None], chi), np.cross(first.apply(E1), chi)
        chidot = sum(rate[:, None] * slope for rate, slope in zip(np.asarray(state.thetadot).T, along, strict=True))
        Lambda = rotations(state)
        rhodot = in_space(Lambda, np.cross(state.Omega, chi) + chidot)
        return Lambda, in_space(Lambda, state.Omega), in_space(Lambda, chi), rhodot, chi, chidot

    start = jaxball.BallState(
        q=(0.9, 0.1, -0.3, 0.3),
        Omega=(0.3, 0.5, -0.7),
        z=(0.4, -0.3),
        theta=(0.3, -0.5),
        thetadot=(1.1, 0.6),
    )

    @pytest.mark.thorough
    def test_integrals_of_a_passive_one(self):
        """Vertical spin of the ball, horizontal momentum and e3·ρ × ρ̇."""
        done = run(self.ball(), self.start, 6.0)
        _, omega, rho, rhodot, _, _ = self.swinging(done.state)
        velocity = R * np.cross(omega, E3[None])
        momentum = (self.sled * velocity + self.m * (velocity + rhodot))[:, :2]
        assert np.ptp(rho[:, 0]) > self.l / 2
        assert spread(omega[:, 2]) < 1e-11
        assert spread(momentum) < 1e-11
        assert spread(np.cross(rho, rhodot)[:, 2]) < 1e-11

    @pytest.mark.thorough
    def test_small_oscillations(self):
        """ω² = (g/l)(d + (m₀ + m) r²)/(d + m₀ r²), both ways; at 4e-6 rad the next order is 1e-10 of the motion."""
        amplitude = np.array([2e-6, -4e-6])
        start = jaxball.BallState(theta=amplitude, thetadot=(0.0, 0.0))
        done = run(self.ball(), start, 6.0, tolerance=SHARP)
        frequency = np.sqrt(G / self.l * (D + (M + self.m) * R**2) / (D + M * R**2))
        _, _, rho, *_ = self.swinging(done.state)
        expected = rho[0, :2] * np.cos(frequency * done.times)[:, None]
        np.testing.assert_allclose(rho[:, :2], expected, rtol=0, atol=1e-9 * np.max(np.abs(amplitude)))

    @pytest.mark.thorough
    def test_conical(self):
        """At the angle a it circles at w² = g (m + m_c)/(l m_c cos a)."""
        m, l, sled, a = self.m, self.l, self.sled, 0.7
        w = np.sqrt(G * (m + sled) / (l * sled * np.cos(a)))
        Omega = m / (m + sled) * w * l * np.sin(a) / R
        start = jaxball.BallState(Omega=Omega * E2, theta=(0.0, a), thetadot=(w * np.tan(a) - Omega, 0.0))
        done = run(self.ball(), start, 6.0)
        _, _, rho, *_ = self.swinging(done.state)
        turned = np.exp(1j * w * done.times)
        np.testing.assert_allclose(plane(rho), plane(rho)[0] * turned, atol=1e-11)
        np.testing.assert_allclose(rho[:, 2], -l * np.cos(a), atol=1e-11)

    @pytest.mark.thorough
    def test_an_accelerating_ground_is_a_tilted_one(self):
        """Ẍ constant is felt as −**g** is: in direction, and in strength."""
        steady = np.array([0.3, -0.4, 0.5])
        accelerated = self.ball(ground=ground(steady=steady), **UNBALANCED)
        felt = -G * E3 - steady
        strength = np.linalg.norm(felt)
        tilted = ground(angle=np.arccos(-felt[2] / strength), heading=np.arctan2(felt[1], felt[0]))
        expected = run(self.ball(ground=tilted, gravity=strength, **UNBALANCED), self.start, 6.0).state
        found = run(accelerated, self.start, 6.0).state
        assert spread(np.asarray(found.z)) > 1
        for name, value in arrays_of(found).items():
            np.testing.assert_allclose(value, getattr(expected, name), atol=1e-11, err_msg=name)

    def test_a_lifted_ground_is_stronger_gravity(self):
        expected = run(self.ball(gravity=G + 0.7, **UNBALANCED), self.start, 6.0).state
        lifted = self.ball(ground=ground(steady=0.7 * E3), **UNBALANCED)
        for name, value in arrays_of(run(lifted, self.start, 6.0).state).items():
            np.testing.assert_allclose(value, getattr(expected, name), atol=1e-11, err_msg=name)

    def test_moving_energy_on_a_turntable(self):
        """E − W L is constant on a level turntable that turns at a constant rate, while E and L are not."""
        W, centre = 0.8, np.array([0.3, -0.2])
        inertia, offset = np.array(UNBALANCED["inertia"]), np.array(UNBALANCED["offset"])
        done = run(self.ball(ground=ground(W=W, centre=centre), **UNBALANCED), self.start, 6.0)
        Lambda, _, _, _, chi, chidot = self.swinging(done.state)
        Omega, Gamma = np.asarray(done.state.Omega), Lambda[:, 2]
        arm = np.pad(np.asarray(done.state.z) - centre, ((0, 0), (0, 1)))
        u = in_space(Lambda.swapaxes(1, 2), W * np.cross(E3[None], arm))
        masses = ((M, np.broadcast_to(offset, chi.shape), np.zeros_like(chi)), (self.m, chi, chidot))
        E, P, Pi = 0.5 * Omega**2 @ inertia, 0.0, inertia * Omega
        for m, at, moved in masses:
            s = R * Gamma + at
            v = np.cross(Omega, s) + moved + u
            E = E + m * np.sum(v**2, axis=1) / 2 + m * G * np.sum(at * Gamma, axis=1)
            P, Pi = P + m * v, Pi + m * np.cross(s, v)
        L = (in_space(Lambda, Pi) + np.cross(arm, in_space(Lambda, P)))[:, 2]
        assert min(spread(E), spread(L)) > 0.1
        assert spread(E - W * L) < 1e-11


@pytest.mark.thorough
class TestPlanarPendulumOnASpring:
    """φ and ψ turn ball and pendulum; its pivot is h above the centre, the ball's centre of mass a below."""

    m, l, h, a = 0.5, 0.5, 0.2, 0.15

    def ball(self, stiffness):
        pendulum = jaxball.planar_pendulum(self.m, self.l, pivot=self.h * E3, drive=jaxball.Spring(stiffness=stiffness))
        return body(offset=-self.a * E3, mechanisms=[pendulum], ground=None)

    def test_small_oscillations(self):
        """By the mass and the stiffness matrix; at 4e-6 rad the next order is 1e-10 of the motion."""
        m, l, h, a, spring = self.m, self.l, self.h, self.a, 0.7
        mixed = -m * l * (R + h)
        inertia = [[D + M * (R - a) ** 2 + m * (R + h) ** 2, mixed], [mixed, m * l**2]]
        stiffness = [[G * (M * a - m * h) + spring, -spring], [-spring, m * G * l + spring]]
        squares, modes = eigh(stiffness, inertia)
        start = np.array([2e-6, -4e-6])
        done = run(
            self.ball(spring),
            jaxball.BallState(
                q=[np.cos(start[0] / 2), *(np.sin(start[0] / 2) * E2)], theta=start[1:] - start[:1], thetadot=[0.0]
            ),
            6.0,
            tolerance=SHARP,
        )
        parts = modes * np.linalg.solve(modes, start)
        expected = np.cos(np.sqrt(squares) * np.asarray(done.times)[:, None]) @ parts.T
        phi = 2 * np.arctan2(done.state.q[:, 2], done.state.q[:, 0])
        found = np.stack([phi, phi + np.asarray(done.state.theta)[:, 0]], axis=1)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 * np.max(np.abs(start)))

    def fixed(self, times, phi):
        """The rolling of the ball whose pendulum is fixed, from rest: Lagrange's equation in φ, by SciPy."""
        masses = np.array([M, self.m])
        heights = np.array([-self.a, self.h - self.l])

        def rates(t, x):
            sine, cosine = np.sin(x[0]), np.cos(x[0])
            J = D + masses @ (R**2 + 2 * R * heights * cosine + heights**2)
            slope = masses @ (-2 * R * heights * sine)
            return [x[1], (G * masses @ heights * sine - slope * x[1] ** 2 / 2) / J]

        solved = solve_ivp(rates, times[[0, -1]], [phi, 0.0], t_eval=times, method="DOP853", rtol=1e-12, atol=1e-12)
        return solved.y[0]

    def test_a_stiff_spring_holds_the_mass(self):
        """The error falls with one over the stiffness, to 4 % between these two."""
        errors = []
        for stiffness in (400.0, 1600.0):
            start = jaxball.BallState(q=[np.cos(0.5), *(np.sin(0.5) * E2)], theta=[0.0], thetadot=[0.0])
            done = run(self.ball(stiffness), start, 3.0)
            phi = 2 * np.arctan2(done.state.q[:, 2], done.state.q[:, 0])
            errors.append(np.sqrt(np.mean((phi - self.fixed(done.times, 1.0)) ** 2)))
        assert errors[0] < 1e-2
        assert errors[0] / errors[1] == pytest.approx(4, rel=0.1)


STILL = {"theta": np.array([0.2, -0.4, 1.0]), "thetadot": np.zeros(3)}


@pytest.mark.thorough
class TestRotors:
    """Rings of axial inertia C, whose motors turn them with the torques Q; K = ∫ Q."""

    m, radius = 0.3, 0.4
    C = m * radius**2
    amplitude, frequency, phase = (
        np.array([[0.3], [-0.2], [0.25]]),
        np.array([[1.0], [1.4], [0.7]]),
        np.array([[0.3], [1.2], [-0.4]]),
    )

    def rotors(self, axes=(E1, E2, E3), centres=((0.0, 0.0, 0.0),) * 3, on=(1.0, 1.0, 1.0), count=3):
        drives = [
            jaxball.Motor(jaxball.Sinusoids(0.0, amplitude=size * a, frequency=w, phase=p))
            for size, a, w, p in zip(on, self.amplitude, self.frequency, self.phase, strict=True)
        ]
        return [
            jaxball.ring_rotor(self.m, self.radius, axis=axis, centre=centre, drive=drive, count=count)
            for axis, centre, drive in zip(axes, centres, drives, strict=True)
        ]

    def impulse(self, t, on=(1.0, 1.0, 1.0)):
        a, w, p = np.asarray(on)[:, None] * self.amplitude, self.frequency, self.phase
        return (a / w * (np.cos(p) - np.cos(w * t + p))).T

    def ball(self, rotors, **changes):
        return body(mechanisms=rotors, ground=None, **changes)

    whole = D + 2 * C  # about each axis
    mass = M + 3 * m

    def test_three_roll_a_balanced_ball_from_rest(self):
        """Ω = −[K + M r²/(D − C) Γ (Γ·K)]/(D − C + M r²)."""
        q = Rotation.from_rotvec([0.4, -0.3, 0.6]).as_quat()
        done = run(self.ball(self.rotors()), jaxball.BallState(q=np.roll(q, 1), **STILL), 6.0)
        given, Gamma = self.impulse(done.times), rotations(done.state)[:, 2]
        rest, rolling = self.whole - self.C, self.mass * R**2
        along = np.sum(Gamma * given, axis=1, keepdims=True)
        expected = -(given + rolling / rest * Gamma * along) / (rest + rolling)
        np.testing.assert_allclose(done.state.Omega, expected, atol=1e-11)

    def test_a_horizontal_one_rolls_the_ball_straight(self):
        """(D − C + M r²) φ̈ = −Q about its axis E2; the others, without torque, keep still in the ball."""
        on = (0.0, 1.0, 0.0)
        done = run(self.ball(self.rotors(on=on)), jaxball.BallState(**STILL), 6.0)
        expected = -self.impulse(done.times, on) / (self.whole - self.C + self.mass * R**2)
        np.testing.assert_allclose(done.state.Omega, expected, atol=1e-12)
        np.testing.assert_allclose(done.state.z[:, 1], 0.0, atol=1e-12)

    def anywhere(self, count=3):
        rng = np.random.default_rng(7)
        axes, centres = rng.normal(size=(3, 3)), 0.2 * rng.normal(size=(3, 3))
        rotors = self.rotors(axes, centres, count=count)
        unbalanced = self.ball(rotors, **UNBALANCED)
        spinning = {**STILL, "thetadot": np.array([2.0, -3.0, 1.0])}
        return axes, run(unbalanced, jaxball.BallState(Omega=(0.3, 0.5, -0.7), **spinning), 6.0)

    def test_anywhere_its_momentum_changes_by_the_motor_alone(self):
        """C (n·Ω + θ̇)˙ = Q, in an unbalanced ball."""
        axes, done = self.anywhere()
        unit = axes / np.linalg.norm(axes, axis=1, keepdims=True)
        momentum = self.C * (np.asarray(done.state.Omega) @ unit.T + np.asarray(done.state.thetadot))
        np.testing.assert_allclose(momentum - momentum[0], self.impulse(done.times), atol=1e-11)

    def test_three_masses_on_a_ring_move_as_four(self):
        _, expected = self.anywhere()
        _, found = self.anywhere(count=4)
        for name, value in arrays_of(found.state).items():
            np.testing.assert_allclose(value, getattr(expected.state, name), atol=1e-11, err_msg=name)


@pytest.mark.thorough
class TestGyroscopicPendulum:
    m, l, radius, torque = 0.4, 0.35, 0.3, 0.05
    axial = m * radius**2
    start = jaxball.BallState(Omega=(0.3, 0.5, -0.7), theta=(0.3, -0.5, 0.2), thetadot=(1.1, 0.6, 5.0))

    def ball(self, mechanism):
        return body(mechanisms=[mechanism], ground=None, **UNBALANCED)

    def made(self):
        drives = (None, None, jaxball.Motor(self.torque))
        return jaxball.physics.gyroscopic_pendulum(self.m, self.l, self.radius, drives=drives, count=6)

    def test_the_ring_spins_up_by_its_motor_alone(self):
        """Along its axis n, carried by the yoke, C n·(Ω + the yoke's turning) + C θ̇₃ grows by the motor's torque."""
        done = run(self.ball(self.made()), self.start, 4.0)
        theta, rates = np.asarray(done.state.theta), np.asarray(done.state.thetadot)
        first, second = Rotation.from_rotvec(theta[:, :1] * E2), Rotation.from_rotvec(theta[:, 1:2] * E1)
        n = (first * second).apply(-E3)
        turning = done.state.Omega + rates[:, :1] * E2 + rates[:, 1:2] * first.apply(E1)
        momentum = self.axial * (np.sum(n * turning, axis=1) + rates[:, 2])
        np.testing.assert_allclose(momentum - momentum[0], self.torque * done.times, atol=1e-11)

    def test_the_ring_is_a_rigid_body(self):
        hinges = self.made().joints
        moments = self.axial * np.array([0.5, 0.5, 1.0])
        rigid = jaxball.rigid_body_masses(self.m, moments, centre=-self.l * E3)
        expected = run(self.ball(self.made()), self.start, 4.0)
        found = run(self.ball(jaxball.Mechanism(hinges, rigid)), self.start, 4.0)
        for name, value in arrays_of(found.state).items():
            np.testing.assert_allclose(value, getattr(expected.state, name), atol=1e-11, err_msg=name)


@pytest.mark.thorough
def test_a_mass_on_three_free_sliders_is_not_felt_and_falls():
    """In an unbalanced ball on a tilted, shaken ground with a turntable and resistance."""
    m, place = 0.7, np.array([0.1, -0.2, 0.3])
    axes = Rotation.from_rotvec([0.4, -0.3, 0.6]).as_matrix()
    a, b, swing = 0.2, 0.7, np.array([0.3, -0.2, 0.1])
    surroundings = {
        "ground": ground(angle=a, heading=b, swing=swing, W=0.7, wobble=0.05, centre=(0.3, -0.2)),
        "resistance": jaxball.Resistance(0.1, 0.05, 0.1, 0.05),
        **UNBALANCED,
    }
    sliders = jaxball.Mechanism([jaxball.Slider(axis) for axis in axes], [jaxball.CarriedMass(m, place)])
    start = {"Omega": np.array([0.3, 0.5, -0.7]), "z": np.array([0.4, -0.3])}
    theta, thetadot = np.array([0.2, -0.1, 0.15]), np.array([0.4, 0.6, -0.3])
    state = jaxball.BallState(theta=theta, thetadot=thetadot, **start)
    loaded = run(body(mechanisms=[sliders], **surroundings), state, 3.0, inside=False)
    alone = run(body(**surroundings), jaxball.BallState(**start), 3.0)
    for name in ("q", "Omega", "z"):
        np.testing.assert_allclose(getattr(loaded.state, name), getattr(alone.state, name), atol=1e-11, err_msg=name)
    t = np.asarray(loaded.times)[:, None]
    chi = place + np.asarray(loaded.state.theta) @ axes
    x = np.pad(loaded.state.z, ((0, 0), (0, 1))) + in_space(rotations(loaded.state), chi)
    velocity = R * np.cross(start["Omega"], E3) + 0.8 * np.cross(E3, np.append(start["z"] - (0.3, -0.2), 0.0))
    velocity = velocity + np.cross(start["Omega"], chi[0]) + thetadot @ axes
    weight = G * np.array([np.sin(a) * np.cos(b), np.sin(a) * np.sin(b), -np.cos(a)])
    falling = x[0] + velocity * t + weight * t**2 / 2 - swing * (1 - np.cos(FREQUENCY * t))
    np.testing.assert_allclose(x, falling, atol=1e-11)


def chebyshev(t, theta, thetadot, state, p):
    """A force by its Chebyshev polynomials over the run."""
    angle = jnp.arccos(jnp.clip(2 * t / p["until"] - 1, -1.0, 1.0))
    return jnp.sum(p["coefficients"] * jnp.cos(angle * jnp.arange(p["coefficients"].size, dtype=t.dtype)))


@pytest.mark.long
def test_efforts_of_a_prescribed_run_move_free_joints_alike():
    """Read off at 65 Chebyshev points, the efforts are known to 1e-11 between them."""
    until, rail = 3.0, jaxball.Circle(0.5, centre=(0.0, 0.0, -0.1))
    schedules = [
        jaxball.Sinusoids(0.1, amplitude=[0.5], frequency=[1.3], rate=0.4),
        jaxball.Sinusoids(-0.3, amplitude=[0.4], frequency=[1.9], phase=[0.5]),
    ]

    def ball(drives):
        robot = jaxball.physics.turning_rail(0.6, rail, drives=drives)
        return body(mechanisms=[robot], ground=None, **UNBALANCED)

    start = {"Omega": np.array([0.3, 0.5, -0.7])}
    points = until / 2 * (1 - np.cos(np.pi * np.arange(65) / 64))
    told = run(ball(schedules), jaxball.BallState(**start), points, tolerance=SHARP)
    seen = told.observables
    coefficients = np.polynomial.chebyshev.chebfit(2 * points / until - 1, seen.joint_efforts, 64)
    assert np.max(np.abs(coefficients[-8:])) < 1e-11
    forces = [
        jaxball.physics.FunctionJointForce(chebyshev, {"coefficients": jnp.asarray(c), "until": jnp.asarray(until)})
        for c in coefficients.T
    ]
    angles = {"theta": seen.joint_angles[0], "thetadot": seen.joint_rates[0]}
    free = run(ball(forces), jaxball.BallState(**start, **angles), points)
    np.testing.assert_allclose(free.state.theta, seen.joint_angles, atol=1e-10)
    np.testing.assert_allclose(free.state.thetadot, seen.joint_rates, atol=1e-10)
    np.testing.assert_allclose(free.state.Omega, told.state.Omega, atol=1e-10)
