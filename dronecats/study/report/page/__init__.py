"""The report as one file for a browser: no program in it, nothing from a network, dark and light, and for paper."""
