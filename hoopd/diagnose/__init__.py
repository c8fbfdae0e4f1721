"""Diagnosis: what a recording is worth, where a model misses it, and what it leaves out."""
