"""The local plane: what clients on this side say to the daemon, and how it answers. See `protocol` for the contract."""
