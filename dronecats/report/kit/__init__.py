"""The kit of every page: palette, style, bar with the theme switch, and the file that a browser opens."""
