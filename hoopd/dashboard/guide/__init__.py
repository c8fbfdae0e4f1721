"""The guided calibration: steps in their order, what each found, and the versions that were accepted."""
