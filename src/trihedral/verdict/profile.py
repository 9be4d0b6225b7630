"""Tolerance profiles: the limits that a job must keep to pass."""

from dataclasses import dataclass

from trihedral.errors import OptionError

# Two-sided 95 % of a normal distribution, in sigmas.
_SIGMAS_95 = 1.959963984540054


@dataclass(frozen=True)
class Profile:
    """Limits on accepted links and placed stations, millimetres; None: that figure is not judged.

    A limit is kept when the figure is at most the limit.
    """

    name: str
    #: One clause for people.
    text: str
    #: 95th percentile of each accepted link's point-to-plane distances.
    link_p95_mm: float | None = None
    #: 90th percentile of the same.
    link_p90_mm: float | None = None
    #: 1.96 sigma of each station's least certain coordinate.
    station_95_mm: float | None = None

    def __post_init__(self) -> None:
        for field in ("link_p95_mm", "link_p90_mm", "station_95_mm"):
            limit = getattr(self, field)
            if limit is not None and not limit > 0.0:
                raise OptionError(f"profile {self.name}: {field} must be a positive number, not {limit}.")

    def link_problem(self, p90_m: float | None, p95_m: float | None) -> str | None:
        """Say what keeps an accepted link from passing, or None.

        Where the 90th percentile was not recorded, the 95th, which is never smaller, stands in for it. A
        figure that is needed and missing is a problem too: what was not measured has not passed.
        """
        if p90_m is None:
            p90_m = p95_m
        for what, figure, limit_mm in (("P95", p95_m, self.link_p95_mm), ("P90", p90_m, self.link_p90_mm)):
            if limit_mm is None:
                continue
            if figure is None:
                return f"{what} was not measured"
            if not figure * 1e3 <= limit_mm:
                return f"{what} {figure * 1e3:.1f} mm is over {limit_mm:g} mm"
        return None

    def station_problem(self, sigma_translation_m: tuple[float, float, float] | None) -> str | None:
        """Say what keeps a placed station from passing, or None."""
        if self.station_95_mm is None:
            return None
        if sigma_translation_m is None:
            return "its uncertainty was not computed"
        radius_mm = _SIGMAS_95 * max(sigma_translation_m) * 1e3
        if not radius_mm <= self.station_95_mm:
            return f"position known to {radius_mm:.1f} mm (95 %), over {self.station_95_mm:g} mm"
        return None


def _loa(level: int, limit_mm: float) -> Profile:
    return Profile(
        f"loa{level}",
        f"the {limit_mm:g} mm bound of USIBD LOA{level} on link P95 and on station position (95 %)",
        link_p95_mm=limit_mm,
        station_95_mm=limit_mm,
    )


PROFILES: dict[str, Profile] = {
    profile.name: profile
    for profile in (
        Profile("exterior", "link P95 at most 15 mm", link_p95_mm=15.0),
        Profile("interior", "link P95 at most 10 mm", link_p95_mm=10.0),
        Profile("under-6mm", "90 % of each link's distances at most 6 mm", link_p90_mm=6.0),
        # Upper bounds of the classes in the USIBD Level of Accuracy specification, 95 % confidence.
        _loa(20, 50.0),
        _loa(30, 15.0),
        _loa(40, 5.0),
        _loa(50, 1.0),
        Profile("none", "no limits"),
    )
}
DEFAULT_PROFILE = PROFILES["exterior"]


def profile_named(name: str) -> Profile:
    """Find a profile by its name.

    Raises
    ------
    OptionError
        There is none; the message lists those there are.
    """
    try:
        return PROFILES[name]
    except KeyError:
        raise OptionError(
            f"There is no tolerance profile {name!r}; there are {', '.join(PROFILES)}."
        ) from None
