"""Pilots without a multimodal model: vision, oracle, noisy, blind, recorded, failing. They have a model's interface."""
