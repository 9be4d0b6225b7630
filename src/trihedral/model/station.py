"""A station of the network, before it has a pose."""

from dataclasses import dataclass

from trihedral.scan import ScanHeader


@dataclass(frozen=True)
class Station:
    """A station of the network."""

    name: str
    header: ScanHeader
    points: int
    content: str  # hash of what it holds; decides where names and order must not
