"""Motions of the ball beyond the bottom: planned on the hoop's own equations, tracked, and judged from a recording."""
