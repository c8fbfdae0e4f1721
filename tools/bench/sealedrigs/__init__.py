"""Rigs whose parameters and physics nobody is told of, and what is made of a recording of them."""
