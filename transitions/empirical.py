"""Empirical mode decomposition of a signal, with the instantaneous frequencies of its modes by the Hilbert transform.

The optional package EMD-signal does the sifting.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from bvp.texts import brief, shown
from transitions.spectrum import checked

__all__ = ["IntrinsicModes", "NotInstalled", "decompose", "sifting"]


class NotInstalled(ImportError):
    """An optional package is missing; the message is one line and says what to install."""


@brief
@dataclass(frozen=True, eq=False)
class IntrinsicModes:
    """A signal as a sum of intrinsic mode functions and a residue.

    Parameters
    ----------
    times : (m,) float
    functions : (k, m) float
        The intrinsic mode functions, fastest first.
    residue : (m,) float
        The rest, which does not oscillate. The signal is the sum of the functions and the residue.
    frequencies : (k, m) float
        Instantaneous angular frequencies, the rate of the phase of the analytic signal. They are negative where a mode has riding waves,
        and have no meaning near the ends of the record.
    amplitudes : (k, m) float
        Modulus of the analytic signal.
    """

    times: np.ndarray
    functions: np.ndarray
    residue: np.ndarray
    frequencies: np.ndarray
    amplitudes: np.ndarray

    @property
    def mean_frequencies(self) -> np.ndarray:
        """Mean angular frequency (k,) of each mode, weighted by its squared amplitude: the centre of its power spectrum."""
        return np.sum(self.frequencies * self.amplitudes**2, axis=1) / np.sum(self.amplitudes**2, axis=1)

    @property
    def orthogonality(self) -> float:
        """Index of orthogonality, 0 for orthogonal parts: sum_t sum_{i != j} c_i(t) c_j(t) / sum_t X(t)^2 with X the sum of all parts c.

        It is the index of Huang et al. (1998), but with separate sums over time in numerator and denominator, because X passes through
        zero."""
        parts = np.vstack([self.functions, self.residue])
        total = float(np.sum(np.sum(parts, axis=0) ** 2))
        return (total - float(np.sum(parts**2))) / total if total > 0.0 else 0.0


def sifting() -> Any:
    """Return the sifting object of the package EMD-signal.

    Raises
    ------
    NotInstalled
        If the package is missing.
    """
    try:
        from PyEMD import EMD
    except ImportError as error:
        message = 'empirical mode decomposition needs the package EMD-signal, which is not installed; expected: pip install "saltus[emd]"'
        raise NotInstalled(message) from error
    return EMD()


def decompose(times: np.ndarray, signal: np.ndarray, *, most: int | None = None) -> IntrinsicModes:
    """Decompose a signal into intrinsic mode functions.

    Parameters
    ----------
    times : (m,) float
        Uniform.
    signal : (m,) float
    most : int, optional
        Largest number of functions.

    Returns
    -------
    IntrinsicModes

    Raises
    ------
    NotInstalled
        If EMD-signal is missing.
    ValueError
        For times that are not uniform, or fewer than eight.

    Notes
    -----
    Huang, Shen, Long, Wu, Shih, Zheng, Yen, Tung, Liu, Proc. R. Soc. Lond. A 454 (1998) 903.
    """
    from scipy.signal import hilbert

    times, signal, step = checked(times, signal)
    if most is not None and (isinstance(most, bool) or not isinstance(most, int) or most < 1):
        raise ValueError(f"most is an integer of 1 or more; received {shown(most)}")
    # EMD-signal stops at absolute ranges and sums, which fit signals of size 1.
    size = float(np.ptp(signal)) or 1.0
    sifter = sifting()
    sifter.emd(signal / size, times - times[0], max_imf=-1 if most is None else most)
    functions = size * np.asarray(sifter.get_imfs_and_residue()[0], dtype=float).reshape(-1, len(times))
    analytic = np.array([hilbert(function) for function in functions]).reshape(functions.shape)
    frequencies = np.gradient(np.unwrap(np.angle(analytic), axis=1), step, axis=1)
    return IntrinsicModes(times, functions, signal - functions.sum(axis=0), frequencies, np.abs(analytic))
