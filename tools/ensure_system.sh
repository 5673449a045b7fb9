#!/usr/bin/env bash
# Looks for what the system tests need of the system: Chromium and its driver, which the browser tests
# drive, and libusb, without which RealSense's library does not load. Where one is missing, root gets
# Debian's packages, and everybody else the command to type.
set -euo pipefail

is_there() {
  command -v chromium >/dev/null && command -v chromedriver >/dev/null &&
    python3 -c 'import ctypes; ctypes.CDLL("libusb-1.0.so.0")' 2>/dev/null
}

packages="chromium chromium-driver libusb-1.0-0"
install="apt-get update && apt-get install -y --no-install-recommends $packages"

if is_there; then
  exit 0
fi
if ! command -v apt-get >/dev/null; then
  echo "The system tests need chromium, chromedriver and libusb 1.0: install them, then try again." >&2
  exit 1
fi
if [ "$(id -u)" -ne 0 ]; then
  echo "The system tests need chromium, chromedriver and libusb 1.0. Type this, then try again:" >&2
  echo "  sudo sh -c '$install'" >&2
  exit 1
fi
echo "Installing $packages for the system tests"
DEBIAN_FRONTEND=noninteractive sh -c "$install" >/dev/null
is_there
