"""The made-up office floor, for tests of the verdict on a whole job."""

from support.office import site, troubled

__all__ = ["site", "troubled"]
