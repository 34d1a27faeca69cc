"""The report's tables as files: Markdown, LaTeX and CSV."""
