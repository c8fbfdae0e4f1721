"""Measurements on recordings of real devices, which are read where they are and never copied into this repository."""
