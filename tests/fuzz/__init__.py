"""Readers in Python under damaged files, for as long as one likes: `make fuzz`."""
