"""Searches, a module each, which is loaded when it is chosen (`hopdiff.doors`): the library of one is slow to load."""
