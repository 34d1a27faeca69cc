"""Everything that crosses a wall between two rooms, declared once.

This is the only part of `dronecats` that the other rooms may import. It imports nothing of ours.
"""
