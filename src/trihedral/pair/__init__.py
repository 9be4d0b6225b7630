"""The method for a pair, one line a step: the default's, the paper's, and the preview that comes before either.

In: two prepared scans. Out: a `model.link.Link`.
"""
