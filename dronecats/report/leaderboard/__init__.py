"""Archives: one file with all that is needed to judge runs again, its verification, and the leaderboard."""
