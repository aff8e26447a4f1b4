"""Recordings and transitions from and to the formats of other tools."""
