"""Robust and resilient object insertion with a soft robotic wrist."""
