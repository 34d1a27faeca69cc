"""Suites of episodes: which flights a benchmark needs, the engines that fly them, and bridges to other harnesses."""
