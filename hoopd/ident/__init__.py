"""Identification: models from recordings."""
