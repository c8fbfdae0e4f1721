"""Missing physics as objects, one file per slot."""
