"""Reads finished runs and presents them as tables, figures, pages, SQL, archives and other file formats."""
