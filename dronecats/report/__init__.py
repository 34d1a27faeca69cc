"""Reads runs back: tables, figures, pages, SQL, archives and other file formats."""
