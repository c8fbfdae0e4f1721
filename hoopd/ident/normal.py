"""Quantiles of the normal distribution that intervals are made of."""

from __future__ import annotations

# Two-sided 95 %.
Z95 = 1.959963984540054
