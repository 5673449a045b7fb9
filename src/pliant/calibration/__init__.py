"""What a cell's configuration needs and a person cannot measure well: where the camera stands, how
stiff the wrist is, what colours the peg and the block have. The cell finds them out by itself.
"""
