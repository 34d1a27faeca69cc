"""Benchmarks: the flights of a suite of episodes, the engines that fly them, and bridges to other harnesses."""
