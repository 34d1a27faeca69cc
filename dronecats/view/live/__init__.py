"""A flight in the browser while it is flown: the same page that `dronecats replay` shows again."""
