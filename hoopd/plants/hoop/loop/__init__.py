"""The loop closed around the hoop: where it can stay, a controller on trial, experiments, what a daemon compensates."""
