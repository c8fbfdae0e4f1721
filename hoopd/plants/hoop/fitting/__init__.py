"""Fits of the hoop: what is free, by which method, how well it repeats a recording and what it does not determine."""
