"""The tests: a folder a room, and `system` for what only the whole shows. Helpers are imported as `tests.…`."""
