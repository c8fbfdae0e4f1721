"""Seeds: those that thresholds are tuned on are written down, those that count are drawn when the run begins.

Rules of this file: a score seed never equals a tuning seed; a drawn seed is stored, so that a run can go on.
"""

from __future__ import annotations

import secrets

TUNING = tuple(range(1, 101))  # of `generate` and `--tuning`
FIRST_SCORE = 2**32  # no one types a number like that by chance


def score_seed() -> int:
    """A seed from the system's randomness, far above every tuning seed."""
    return FIRST_SCORE + secrets.randbits(48)


def is_tuning(seed: int) -> bool:
    """Was this seed open to those who tune?"""
    return seed < FIRST_SCORE
