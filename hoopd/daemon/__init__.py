"""The composition of the daemon: what runs the tick in its worlds, experiments and replays."""
