"""Stations and links as a graph; every walk over it is linear in links."""
