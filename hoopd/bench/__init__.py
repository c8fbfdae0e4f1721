"""The engineer's bench: one module per offline command, from files to files."""
