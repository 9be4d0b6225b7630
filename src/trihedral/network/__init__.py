"""Many scans: candidate pairs, links judged together, constraints, the adjustment of all stations.

In: links and stations. Out: a `model.registration.Registration`.
"""
