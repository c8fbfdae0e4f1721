"""Curves at every slot: what is missing where no law of the library explains it."""
