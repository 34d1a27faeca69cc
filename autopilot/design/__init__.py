"""Computes the gains of an airframe and draws its loops."""
