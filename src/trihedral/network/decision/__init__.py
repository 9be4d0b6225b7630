"""Which links are believed once all are seen together.

In: links as pairs left them. Out: links kept or refused with their reasons, loops, stations in doubt.
"""
