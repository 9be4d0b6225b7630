"""Many scans: candidate pairs, links kept or refused by loops that close, all poses adjusted at once.

In: prepared scans and links. Out: `Registration`.
"""

from trihedral.network.registration import Loop, Registration, Station, StationStatus

__all__ = ["Loop", "Registration", "Station", "StationStatus"]
