"""Generalised least squares along a recording: filter, noise, joint fits, columns of one-step changes."""
