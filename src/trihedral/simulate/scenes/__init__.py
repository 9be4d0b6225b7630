"""The scenes, one module each; `build` makes one from a seed."""

from collections.abc import Callable

from trihedral.errors import OptionError
from trihedral.simulate.scene import Scene
from trihedral.simulate.scenes.building import building
from trihedral.simulate.scenes.corridor import corridor
from trihedral.simulate.scenes.estate import estate
from trihedral.simulate.scenes.facade import facade
from trihedral.simulate.scenes.floors import floors
from trihedral.simulate.scenes.gallery import gallery
from trihedral.simulate.scenes.hall import hall
from trihedral.simulate.scenes.hotel import hotel
from trihedral.simulate.scenes.office import office
from trihedral.simulate.scenes.rooms import rooms
from trihedral.simulate.scenes.site import site
from trihedral.simulate.scenes.warehouse import warehouse

_MAKERS = (building, corridor, estate, facade, floors, gallery, hall, hotel, office, rooms, site, warehouse)
SCENES: dict[str, Callable[[int], Scene]] = {make.__name__: make for make in _MAKERS}


def build(name: str, seed: int) -> Scene:
    """Make a scene; sizes, layout, counts and looks all come from the seed.

    Raises
    ------
    OptionError
        There is no scene of that name, or the seed is negative.
    """
    if name not in SCENES:
        raise OptionError(f"There is no scene '{name}': choose from {', '.join(SCENES)}.")
    if seed < 0:
        raise OptionError("The seed must be 0 or more.")
    return SCENES[name](seed)
