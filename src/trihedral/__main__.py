"""`python -m trihedral` is the command `trihedral`."""

from trihedral.cli import main

main()
