"""Checks that the options of the simulated instruments share."""

from trihedral.errors import OptionError


def check(subject: str, checks: list[tuple[bool, str]]) -> None:
    """Raise an `OptionError` that names the subject for the first check that failed."""
    for good, message in checks:
        if not good:
            raise OptionError(f"{subject}: {message}.")


def not_negative(options: object, *names: str) -> list[tuple[bool, str]]:
    """Checks of fields that hold standard deviations, sizes and delays."""
    return [(getattr(options, name) >= 0.0, f"{name} must not be negative") for name in names]
