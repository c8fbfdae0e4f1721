"""Rigs on which nothing is broken, and what a laboratory does with them."""
