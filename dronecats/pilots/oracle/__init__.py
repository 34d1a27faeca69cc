"""Pilots that know the truth: the oracle, the noisy oracle, and pilots that fail on purpose."""
