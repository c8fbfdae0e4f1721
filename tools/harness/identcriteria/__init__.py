"""Criteria of the identification toolbox, restated so that they hold for any seed: one function each."""
