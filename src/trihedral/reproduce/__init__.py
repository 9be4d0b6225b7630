"""The source paper's experiments on simulated testbeds: its figures beside ours beside the default method's.

In: which tables, which seeds. Out: `Trial`s, and from them tables as CSV and Markdown and the drawings of its Fig. 5
and of the stations.
"""
