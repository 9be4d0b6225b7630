"""What all rooms say to each other of pairs, stations and results.

Plain types: no room below `model` but `scan` is needed to read one, and no policy is in them.
"""
