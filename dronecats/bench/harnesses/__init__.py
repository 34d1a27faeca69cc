"""Adapters of the benchmark to other harnesses: Inspect, Inspect Robots and Gymnasium."""
