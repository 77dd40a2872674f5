"""Compiled parts that the time loops of several methods share: the codes with which they end."""
