"""A small network as a pilot. It learns from flights of the pilot `oracle`. A server gives it the API of a model.

The steps are in docs/action-head.md. Only code that trains or loads a network needs PyTorch (extra `train`).
"""
