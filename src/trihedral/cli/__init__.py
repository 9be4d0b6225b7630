"""The command line, one file a verb. The only place that prints.

Standard output carries what was asked for; everything else goes to standard error. A verb's module imports
the heavy parts inside its function, so that help is quick.
"""

from trihedral.cli.app import app, main

__all__ = ["app", "main"]
