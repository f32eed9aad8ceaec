"""The velocity of the bank over several intervals."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from stab_ros.core.text import counted
from stab_ros.velocimetry.bank import BankVelocity, bank_velocity
from stab_ros.velocimetry.velocimeter import Measured


def bank_of(measured: Measured) -> BankVelocity:
    """The velocity of the bank in an interval that was measured there alone."""
    return bank_velocity(measured.vectors, measured.zone.mask)


def over_time(banks: Collection[BankVelocity]) -> BankVelocity:
    """The mean of the medians of intervals, each by its number of vectors.

    What all vectors of an interval share, the homographies of its first and last frame, is another error in the next
    one; what is the same for all of them (scale) does not move what stands still.
    """
    counts = np.array([bank.count for bank in banks])
    total = int(counts.sum())
    if not total:
        return BankVelocity(0, np.full(2, np.nan), np.full((2, 2), np.nan))
    seen = [(bank, bank.count / total) for bank in banks if bank.count]
    median = np.sum([share * bank.median_m_s for bank, share in seen], axis=0)
    covariance = np.sum([share**2 * bank.covariance for bank, share in seen], axis=0)
    return BankVelocity(total, median, covariance)


def told(bank: BankVelocity, unit: str) -> str:
    """The velocity of a bank that was measured, in words."""
    x, y = bank.median_m_s
    sigma = float(np.hypot(*bank.sigma_m_s))
    rest = "that is zero within its error bar" if bank.at_rest else "that is not zero"
    measured = f"({x:.2g}, {y:.2g}) {unit}/s with a standard deviation of {sigma:.2g}"
    return f"{measured} ({counted(bank.count, 'vector')}): {rest}"
