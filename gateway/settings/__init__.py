"""What an operator may choose: frozen settings, and the TOML file they are read from.

In comes a file, or nothing; out goes one `Settings` that is inside the robot's hard limits, or an error that names key,
value, bound, unit and remedy. `bounds.py` refuses, `motion.py` and `settings.py` hold the sections with their defaults,
`toml_file.py` reads and writes the file, and alone reads the environment. `reloading.py` says what is taken anew.
Read `settings.py` first.
"""
