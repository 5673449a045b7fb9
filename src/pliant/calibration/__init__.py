"""Calibration: the cell finds out by itself where its camera stands, how stiff its wrist is and
what colours the peg and the block have, which its configuration needs and a person cannot measure
well.
"""
