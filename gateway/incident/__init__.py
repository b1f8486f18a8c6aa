"""The black box: what an engine heard and gave in the last minute, on disk, kept when it matters, and run again."""
