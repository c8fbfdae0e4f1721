"""What tests and benches share: runs of the daemon, drawn pictures, referees, criteria of identification.

Rules of this folder: it imports `hoopd` and nothing of tests/ or tools/bench/; both import it, and neither the other:
only tests/tools imports tools, to test them.
"""
