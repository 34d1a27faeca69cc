"""Models behind one interface: HTTP endpoints and replays, with budget, rate limits and probe."""
