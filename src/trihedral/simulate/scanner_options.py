"""What a terrestrial laser scanner is asked to do."""

import math
from dataclasses import dataclass, replace

from trihedral.errors import OptionError
from trihedral.simulate.beam import Beam
from trihedral.simulate.option_checks import check, not_negative


@dataclass(frozen=True)
class ScannerOptions:
    """What the instrument does; the defaults are those of a mid-range scanner in a quick mode."""

    #: Between neighbouring beams, both ways; the default gives 2 million beams a scan.
    angular_step_deg: float = 0.165
    #: Lowest beam; below it is the tripod.
    elevation_min_deg: float = -60.0
    #: Highest beam.
    elevation_max_deg: float = 90.0
    #: Nothing nearer is measured.
    min_range_m: float = 0.4
    #: Nothing farther is measured.
    max_range_m: float = 120.0
    #: One sigma where the signal is strong.
    range_noise_m: float = 0.002
    #: One sigma more at a signal of 0.5 (half-grey, head-on, 10 m); grows as the root of its inverse.
    signal_noise_m: float = 0.0005
    #: One sigma of the beam's direction against the recorded one, each axis.
    angular_noise_arcsec: float = 8.0
    #: At the exit, 1/e^2.
    beam_diameter_m: float = 0.005
    #: Full angle, 1/e^2.
    beam_divergence_rad: float = 0.0003
    #: Whether the beam's footprint is followed over edges; otherwise the beam is infinitely thin.
    mixed_pixels: bool = True
    #: Echoes nearer to each other than this are averaged, others told apart.
    pulse_length_m: float = 0.3
    #: Echoes of a beam that are written down, the strongest first: those of surfaces that the pulse tells apart.
    returns: int = 1
    #: Added by each pane on the way: 0.002 for 4 mm of glass of index 1.5. It is a fact that no rigid motion
    #: explains, so it is left out of data that registration is measured on unless asked for.
    glass_delay_m: float = 0.0
    #: Reflectance * cos(incidence) * (10 m / range)^2 below which nothing is seen.
    weakest_signal: float = 3e-4
    #: Beams lost at random, 0..1.
    dropout_share: float = 0.001
    #: One sigma, relative.
    intensity_noise: float = 0.03
    #: Whether colours are taken.
    color: bool = True
    #: Whether each scan has a sun and lamps of its own, and the sun casts shadows.
    light_changes: bool = False
    #: One sigma of each component of the compensated tilt.
    level_sigma_deg: float = 0.02
    #: An instrument that is not levelled is tilted by up to this much, in any direction.
    tilt_deg: float = 0.0

    def __post_init__(self) -> None:
        check(
            "Scanner",
            [
                (0.005 <= self.angular_step_deg <= 5.0, "angular_step_deg must lie between 0.005 and 5"),
                (
                    -90.0 <= self.elevation_min_deg < self.elevation_max_deg <= 90.0,
                    "elevation_min_deg must lie below elevation_max_deg, both within -90..90",
                ),
                (0.0 <= self.min_range_m < self.max_range_m, "min_range_m must be below max_range_m"),
                (0.0 <= self.dropout_share < 1.0, "dropout_share must lie in 0..1"),
                (0.0 <= self.tilt_deg <= 60.0, "tilt_deg must lie between 0 and 60"),
                (1 <= self.returns <= 3, "returns must lie between 1 and 3"),
                (self.pulse_length_m > 0.0, "pulse_length_m must be positive"),
                *not_negative(self, "range_noise_m", "signal_noise_m", "angular_noise_arcsec"),
                *not_negative(self, "beam_diameter_m", "beam_divergence_rad", "glass_delay_m"),
                *not_negative(self, "weakest_signal", "intensity_noise", "level_sigma_deg"),
            ],
        )

    def with_beams(self, beams: int) -> "ScannerOptions":
        """Take the angular step with which about this many beams fill the field of view."""
        if beams < 1:
            raise OptionError("Scanner: the number of points a scan must be positive.")
        step = math.sqrt(360.0 * (self.elevation_max_deg - self.elevation_min_deg) / beams)
        return replace(self, angular_step_deg=step)

    @property
    def grid(self) -> tuple[int, int]:
        """Rows and columns."""
        rows = max(1, round((self.elevation_max_deg - self.elevation_min_deg) / self.angular_step_deg))
        return rows, max(1, round(360.0 / self.angular_step_deg))

    @property
    def beam(self) -> Beam:
        """Its width and its pulse."""
        return Beam(self.beam_diameter_m, self.beam_divergence_rad, self.pulse_length_m, self.glass_delay_m)
