"""The benchmark under other people's harnesses: Inspect, Gymnasium and their like."""
