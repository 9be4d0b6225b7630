"""What may be believed: visibility, verdicts on links and stations, tolerance profiles.

In: refined poses and prepared scans. Out: `Link` and station statuses, each with its reason.
"""

from trihedral.verdict.link import Link, LinkVerdict, Residuals, WeakestDirection

__all__ = ["Link", "LinkVerdict", "Residuals", "WeakestDirection"]
