"""Programs beside the daemon. They command the robot through the client library, like anybody else."""
