"""The old place of `gateway.video`, kept importable for one release."""
