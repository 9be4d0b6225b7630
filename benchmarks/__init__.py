"""Measured figures: each stage beside the nearest library, whole sites against their truth (docs/benchmarks.md)."""
