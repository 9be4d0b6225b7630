"""Names of files that are written side by side."""


def distinct(stem: str, taken: set[str]) -> str:
    """Number a name that is taken already, whatever the case, and add it to those that are."""
    name, number = stem, 1
    while name.casefold() in taken:
        number += 1
        name = f"{stem}-{number}"
    taken.add(name.casefold())
    return name
