"""Cases of the fuzz bench (tools/bench/fuzz.py): sound files, ways to spoil them, and who judges what comes of it."""
