"""The command line of `ta2` as data: commands, options, defaults, help texts. Runs nothing.

In: what a person typed.
Out: a namespace of values within their bounds, or the usage of the command that was wrong.
Read first: `arguments.py`.
"""
