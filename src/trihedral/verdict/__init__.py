"""What may be believed: agreement, appearance, verdicts on pairs and on the job, tolerance profiles.

In: poses and prepared scans. Out: evidence and verdicts, each with its reason.
"""
