"""The page of a flight in the browser while it is flown, of which `dronecats replay` uses the same parts."""
