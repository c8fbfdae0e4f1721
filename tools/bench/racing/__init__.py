"""Races of three operators: what they do, in virtual time and over real transports, and who judges it."""
