"""A small network that flies: learnt from the oracle's flights, served like a model, benchmarked like one.

The path is in docs/action-head.md. Only `network`, `train` and what loads a trained head need PyTorch (extra `train`).
"""
