"""The simulated robot's body under physics: MuJoCo behind the extra `sim`. Nothing else of the simulation needs it."""
