"""Registers terrestrial laser scans without targets and says how far each pose may be trusted."""
