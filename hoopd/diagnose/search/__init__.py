"""Which effects of a library the recordings ask for: screens, scans, what chance does, and the search."""
