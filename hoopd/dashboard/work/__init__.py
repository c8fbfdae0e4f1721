"""Recordings and work on them, seen from the page: what lies in a folder, and the bench's own commands as jobs."""
