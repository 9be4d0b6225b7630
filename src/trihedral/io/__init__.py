"""Files in, files out: one module a format, told apart by content.

In: a path. Out: `ScanHeader`, `Scan`, `Photo`. Everything leaves here in metres and station coordinates.
"""
