"""Fits of the device: its declared structures from recordings, by free runs or by the likelihood of a filter."""
