"""The made-up office floor, for tests of documents and pages."""

from support.office import looked, site, site_with_slip, troubled

__all__ = ["looked", "site", "site_with_slip", "troubled"]
