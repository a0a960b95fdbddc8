"""A contact law with closed-form coefficients of one Jenkins element, for comparisons without the error of samples."""

from dataclasses import dataclass

import numpy as np

from microslip.contact.elastic_coulomb import ElasticCoulomb


@dataclass(frozen=True)
class ExactJenkins(ElasticCoulomb):
    """One Jenkins element along x that sticks or slips once in each direction per cycle, with harmonic 1, without samples."""

    @classmethod
    def of(cls, law: ElasticCoulomb) -> "ExactJenkins":
        """Return the law with the parameters of a sampled law."""
        return cls(law.mu, law.N0, law.k_t, law.k_n, law.separate)

    def cycle(self, U, n_samples, tangents=True, harmonics=None):
        exact = super().cycle(U, n_samples, tangents, harmonics)
        a = U[:, 0, 1] - 1j * U[:, 0, 2]
        X = np.abs(a)
        turn = np.divide(a, X, out=np.ones_like(a), where=X > 0.0)
        T, by_X, _, _ = self._harmonic_1(X)
        T_by_X = np.divide(T, X, out=self.k_t + 0j, where=X > 0.0)
        exact.p[:], p = 0.0, T * turn - self.k_t * a
        exact.p[:, 0, 1], exact.p[:, 0, 2] = p.real, -p.imag
        if tangents:
            exact.P[:] = 0.0
            for column, along in ((1, 1.0), (2, -1j)):
                d = along / turn  # derivative by the amplitude, and by its phase times X
                by = (by_X * d.real + 1j * T_by_X * d.imag) * turn - self.k_t * along
                exact.P[:, 1, column], exact.P[:, 2, column] = by.real[exact.active], -by.imag[exact.active]
        return exact

    def parameter_rate(self, name, U, n_samples, harmonics=None):
        rate, a = np.zeros(U.shape), U[:, 0, 1] - 1j * U[:, 0, 2]
        _, _, by_limit, by_k = self._harmonic_1(np.abs(a))
        of_name = {"mu": self.N0 * by_limit, "N0": self.mu * by_limit, "k_t": by_k - np.abs(a)}.get(name, 0.0 * a)
        by = of_name * a / np.abs(a)
        rate[:, 0, 1], rate[:, 0, 2] = by.real, -by.imag
        return rate

    def _harmonic_1(self, X):
        """Return the amplitude of T of cos of amplitude X, and its derivatives by X, by mu N0 and by k_t."""
        limit, k = self.mu * self.N0, self.k_t
        part = np.divide(limit, k * X, out=np.ones_like(X), where=k * X > limit)  # 1 where it sticks
        th = np.arccos(1.0 - 2.0 * part)
        g, sin = th - np.sin(2.0 * th) / 2.0, np.sin(th)
        T = k * X / np.pi * g + 4j * limit / np.pi * (1.0 - part)
        by_X = k / np.pi * (g - 4.0 * part * sin) + 4j * limit / np.pi * part / X
        by_limit = 4.0 / np.pi * (sin + 1j * (1.0 - 2.0 * part))
        return T, by_X, by_limit, X / np.pi * (g - 4.0 * part * sin) + 4j * limit / np.pi * part / k
