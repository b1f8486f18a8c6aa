"""Benchmarks: ratios against a plain peer measured side by side in the same run. `bin/bench`."""
