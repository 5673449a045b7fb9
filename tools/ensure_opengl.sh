#!/usr/bin/env bash
# Draws one picture with MuJoCo. Where that fails, root gets the software OpenGL package (Debian),
# and everybody else the command to type.
set -euo pipefail
cd "$(dirname "$0")/.."

draws() {
  .venv/bin/python - <<'PYTHON'
import pliant.sim  # chooses the back end
import mujoco

model = mujoco.MjModel.from_xml_string(
    "<mujoco><worldbody><light pos='0 0 3'/><geom size='1'/></worldbody></mujoco>"
)
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
with mujoco.Renderer(model, 24, 32) as renderer:
    renderer.update_scene(data)
    if not renderer.render().any():
        raise SystemExit("the picture is black")
PYTHON
}

package=libosmesa6
install="apt-get update && apt-get install -y --no-install-recommends $package"

if reason=$(draws 2>&1); then
  exit 0
fi
echo "${reason##*$'\n'}" >&2 # a traceback's last line
if ! command -v apt-get >/dev/null; then
  echo "MuJoCo cannot draw pictures: install OSMesa (Mesa's software OpenGL), then try again." >&2
  exit 1
fi
if [ "$(id -u)" -ne 0 ]; then
  echo "MuJoCo cannot draw pictures here. Type this, then try again:" >&2
  echo "  sudo sh -c '$install'" >&2
  exit 1
fi
echo "MuJoCo cannot draw pictures here: installing $package"
DEBIAN_FRONTEND=noninteractive sh -c "$install" >/dev/null
if reason=$(draws 2>&1); then
  exit 0
fi
echo "${reason##*$'\n'}" >&2
if MUJOCO_GL=osmesa draws >/dev/null 2>&1; then
  echo "MuJoCo draws only with software OpenGL here: type 'export MUJOCO_GL=osmesa', then try again." >&2
fi
exit 1
