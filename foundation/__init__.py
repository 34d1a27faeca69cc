"""Types and functions that several packages share: types with unit and frame, conversions, errors.

Every package imports it. It imports none of them.
"""
