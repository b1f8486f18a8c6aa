"""What is known of the robot: its latest state, how old and how plausible it is, and whether it does what it is told.

In: samples of state topics. Out: values with their ages; refused jumps; what the body model says of them.
Read first: `store.py`.
"""
