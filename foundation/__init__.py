"""Types and functions that several packages share: types with unit and frame, conversions, errors.

Every package imports this one. It imports no other package of the project.
"""
