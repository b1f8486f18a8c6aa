"""Parts of the body are kept apart, and streams of poses slow near singularities; both by the body model, tick by tick.

In: setpoints that are about to leave, the body model. Out: setpoints that keep the distance, or brakes.
Read first: `spacing.py`.
"""
