import pytest
from fusion_room import Room, make_room


@pytest.fixture(scope="session")
def room() -> Room:
    return make_room()
