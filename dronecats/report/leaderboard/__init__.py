"""Writes and verifies archives of runs, and makes the leaderboard. An archive has all data to judge its runs again."""
