"""Which pairs are tried, out of all.

In: plan descriptors and what came of pairs so far. Out: pairs to preview or register next, each with its reason.
"""
