"""Every figure and use of Kang (1999), made again: `python -m experiments.kang1999` builds the gallery."""
