"""One check: Table I on a picture: the goal picture of Fit, and the same with the board hidden."""

from dataclasses import replace

from pliant.checks import ON_HOLE_M, table_i
from pliant.formations import Formation
from pliant.task import load_task
from pliant.teaching import shipped
from pliant.vision.measure import measure

task = load_task("circle")
view = shipped().demonstrations[Formation.FIT].view  # a picture, and the camera that took it
covered = view.image.copy()
covered[view.camera.height // 2 :] = 255

for image in (view.image, covered):
    scene = measure(replace(view, image=image), task)
    if scene.peg is not None and scene.hole is not None:
        print(
            f"peg at {scene.peg.center_px[0]:.0f} px, tilt {scene.peg.tilt_deg:.1f} deg,", end=" "
        )
        print(f"hole at {scene.hole.center_px[0]:.0f} px, y {scene.hole.y.value * 1e3:+.1f} mm")
    check = table_i(Formation.FIT, scene, ON_HOLE_M / view.camera.metres_per_pixel(0.0))
    print(f"vote {check.vote}: {check.message}")
