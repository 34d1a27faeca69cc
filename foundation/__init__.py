"""Everything that crosses a wall between two rooms, declared once: types with unit and frame, conversions, errors.

Every room stands on it. It imports nothing of ours.
"""
