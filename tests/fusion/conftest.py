import pytest

from support.fusion_room import Room, make_room


@pytest.fixture(scope="session")
def room() -> Room:
    return make_room()
