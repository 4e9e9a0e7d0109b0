"""Other methods for conservative orbits of a system with one odd spring k w^p: DOP853 with the equation of variations, harmonic balance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp


@dataclass(frozen=True)
class OneSpring:
    """M u'' + K u + c k |c . u|^(p - 1) (c . u) = 0. Energy and harmonic balance are for odd p."""

    mass: np.ndarray
    stiffness: np.ndarray
    row: np.ndarray
    coefficient: float
    power: float

    @property
    def size(self) -> int:
        return len(self.row)

    def energy(self, u: np.ndarray, v: np.ndarray) -> float:
        w = float(self.row @ u)
        return float(0.5 * (v @ self.mass @ v + u @ self.stiffness @ u)) + self.coefficient * w ** (self.power + 1) / (self.power + 1)

    def flown(self, state: np.ndarray, time: float, rtol: float = 1e-13) -> tuple[np.ndarray, np.ndarray]:
        """State after a time, and its derivative by the state."""
        n = self.size
        inverse = np.linalg.inv(self.mass)
        linear, push = -inverse @ self.stiffness, -self.coefficient * (inverse @ self.row)

        def right(_: float, y: np.ndarray) -> np.ndarray:
            u, v = y[:n], y[n : 2 * n]
            w, columns = self.row @ u, y[2 * n :].reshape(2 * n, 2 * n)
            steep = abs(w) ** (self.power - 1)
            bent = linear @ columns[:n] + np.outer(push, self.power * steep * (self.row @ columns[:n]))
            return np.concatenate([v, linear @ u + push * steep * w, columns[n:].ravel(), bent.ravel()])

        start = np.concatenate([state, np.eye(2 * n).ravel()])
        end = solve_ivp(right, (0.0, time), start, method="DOP853", rtol=rtol, atol=rtol * 1e-2).y[:, -1]
        return end[: 2 * n], end[2 * n :].reshape(2 * n, 2 * n)

    def rate(self, state: np.ndarray) -> np.ndarray:
        u, v = np.split(state, 2)
        w = float(self.row @ u)
        force = self.coefficient * abs(w) ** (self.power - 1) * w
        return np.concatenate([v, -np.linalg.solve(self.mass, self.stiffness @ u + self.row * force)])

    def quarter(self, velocities: np.ndarray, time: float, energy: float, rtol: float = 1e-13) -> tuple[np.ndarray, float, np.ndarray]:
        """The quarter from the origin to rest at an energy, by Newton's method on flights of DOP853: start velocities, duration, and the
        derivatives of rest velocities and energy by both."""
        n = self.size
        for _ in range(3):
            end, columns = self.flown(np.concatenate([np.zeros(n), velocities]), time, rtol)
            jacobian = np.zeros((n + 1, n + 1))
            jacobian[:n, :n], jacobian[:n, n] = columns[n:, n:], self.rate(end)[n:]
            jacobian[n, :n] = self.mass @ velocities
            residual = np.append(end[n:], 0.5 * velocities @ self.mass @ velocities - energy)
            change = np.linalg.solve(jacobian, residual)
            velocities, time = velocities - change[:n], time - float(change[n])
        return velocities, time, jacobian

    def balanced(self, amplitudes: np.ndarray, rate: float, energy: float) -> tuple[np.ndarray, float]:
        """Harmonic balance u = sum b_k sin(k rate t), k = 1, 3, ..: amplitudes b (H, n) and the rate at an energy, by Newton's method."""
        count, n = amplitudes.shape
        orders = np.arange(1, 2 * count, 2)
        samples = 2 * (self.power + 1) * count
        angles = 2.0 * np.pi * np.arange(samples) / samples
        waves = np.sin(np.outer(angles, orders))
        for _ in range(12):
            w = waves @ (amplitudes @ self.row)
            force = waves.T @ (self.coefficient * w**self.power) * (2.0 / samples)
            slope = waves.T @ ((self.coefficient * self.power * w ** (self.power - 1))[:, None] * waves) * (2.0 / samples)
            residual = amplitudes @ self.stiffness - (orders * rate)[:, None] ** 2 * (amplitudes @ self.mass) + np.outer(force, self.row)
            matrix = np.kron(np.eye(count), self.stiffness) - np.kron(np.diag((orders * rate) ** 2.0), self.mass)
            matrix += np.kron(slope, np.outer(self.row, self.row))
            by_rate = (-2.0 * rate * orders[:, None] ** 2 * (amplitudes @ self.mass)).ravel()
            v = rate * (orders @ amplitudes)
            by_v = self.mass @ v
            last = np.append(np.kron(rate * orders, by_v), by_v @ v / rate)
            whole = np.vstack([np.column_stack([matrix, by_rate]), last])
            change = np.linalg.solve(whole, -np.append(residual.ravel(), 0.5 * v @ by_v - energy))
            amplitudes, rate = amplitudes + change[:-1].reshape(count, n), rate + float(change[-1])
            if np.abs(change).max() < 1e-15:
                break
        return amplitudes, rate
