"""Scans with known truth: scenes, scanner, files."""
