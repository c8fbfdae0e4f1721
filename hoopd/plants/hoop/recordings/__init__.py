"""Recordings of the hoop: made ready for a fit, simulated again, put right, and what in them is doubtful."""
