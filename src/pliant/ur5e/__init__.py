"""The real cell: a UR5e with a soft wrist, a Robotiq gripper and a camera, behind `cell.Robot`.

`configuration.load` reads the cell's file, `cell.UrCell` prepares trials in it. The vendors' own
libraries are used: the extra 'ur5e'.
"""
