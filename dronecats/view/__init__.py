"""Views of flights and maps: in the browser, as films, and the episode editor."""
