"""Child processes: how they are started, kept on a lifeline, asked for signs of life, and never left behind."""
