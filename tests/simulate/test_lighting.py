"""Light that falls on surfaces, where the answer is known, and scans under another one each."""

import numpy as np

from trihedral.simulate import ScannerOptions, make_site
from trihedral.simulate.lighting import at_another_hour, falling_light
from trihedral.simulate.material import INDEX as M
from trihedral.simulate.mesh import MeshBuilder
from trihedral.simulate.scene import Lamp, Light
from trihedral.simulate.tracer import Tracer

UP = np.array([[0.0, 0.0, 1.0]])


def test_a_roof_shades_the_ground_below_it_from_the_sun_alone() -> None:
    b = MeshBuilder(1)
    b.quad((-50, -50, 0), (100, 0, 0), (0, 100, 0), M["asphalt"])
    b.quad((-1, -1, 3), (2, 0, 0), (0, 2, 0), M["asphalt"])
    light = Light((0.5, 0.5, 0.5), 0.1, (0.4, 0.4, 0.4), (0.6, 0.0, 0.8))
    # The roof's shadow lies where the sun's ray backwards leads: 3 m down is 3 * 0.6 / 0.8 m aside.
    places = np.array([[-3 * 0.75, 0.0, 0.0], [0.0, 0.0, 0.0]])
    red, _, _ = falling_light(Tracer(b.mesh()), light, places, np.repeat(UP, 2, axis=0), shadows=True)
    np.testing.assert_allclose(red, [0.6, 0.6 + 0.4 * 0.8])


def test_a_lamp_falls_off_with_distance_and_slant() -> None:
    b = MeshBuilder(1)
    b.quad((-50, -50, 0), (100, 0, 0), (0, 100, 0), M["asphalt"])
    light = Light((0.0,) * 3, 0.0, (0.0,) * 3, (0.0, 0.0, 1.0), (Lamp((0.0, 0.0, 2.0), 3.0),))
    below, aside = np.zeros((1, 3)), np.array([[2.0, 0.0, 0.0]])
    tracer = Tracer(b.mesh())
    np.testing.assert_allclose(falling_light(tracer, light, below, UP, shadows=False)[1], 3.0 / 5.0)
    np.testing.assert_allclose(
        falling_light(tracer, light, aside, UP, shadows=False)[1], 3.0 / 9.0 * np.sqrt(0.5)
    )


def test_every_hour_has_its_own_light() -> None:
    hours = [at_another_hour(Light(), np.zeros(3), np.random.default_rng(seed)) for seed in range(20)]
    assert len({light.towards_sun for light in hours}) == 20
    for light in hours:
        assert np.isclose(np.linalg.norm(light.towards_sun), 1.0)
        assert light.towards_sun[2] > 0


def test_light_changes_colours_and_nothing_else() -> None:
    plain = ScannerOptions().with_beams(20_000)
    changed = ScannerOptions(light_changes=True).with_beams(20_000)
    apart = []
    for before, after in zip(
        make_site("facade", 3, 3, plain), make_site("facade", 3, 3, changed), strict=True
    ):
        np.testing.assert_array_equal(before.xyz, after.xyz)
        np.testing.assert_array_equal(before.intensity, after.intensity)
        assert before.color is not None
        assert after.color is not None
        apart.append(np.median(after.color.astype(int) - before.color.astype(int)))
    assert np.ptp(apart) > 5
