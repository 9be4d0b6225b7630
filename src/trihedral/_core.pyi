"""Types of the Rust module: arrays in, arrays out."""

__version__: str
