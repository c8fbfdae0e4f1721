"""The commands of the command line: each a module with its options, what it does and what it shows."""
