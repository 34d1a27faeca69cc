"""The common elements of all HTML pages: palette, style, bar with the theme switch, and the HTML file itself."""
