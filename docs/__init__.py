"""Pages of the documentation, and `website`, which builds a site from them."""
