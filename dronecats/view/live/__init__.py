"""The browser page that shows a flight while it is flown. `dronecats replay` uses parts of it."""
