"""The common elements of all pages: palette, style, bar with the theme switch, and the HTML file."""
