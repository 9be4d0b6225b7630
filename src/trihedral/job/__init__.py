"""A job on disk: files in, result out, resumed where it was stopped.

In: paths and the stages to run. Out: a registration, and what the next run goes on from.
"""
