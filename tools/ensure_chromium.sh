#!/usr/bin/env bash
# Looks for Chromium and its driver, which the browser tests drive. Where one is missing, root gets
# Debian's packages, and everybody else the command to type.
set -euo pipefail

is_there() {
  command -v chromium >/dev/null && command -v chromedriver >/dev/null
}

packages="chromium chromium-driver"
install="apt-get update && apt-get install -y --no-install-recommends $packages"

if is_there; then
  exit 0
fi
if ! command -v apt-get >/dev/null; then
  echo "The browser tests need chromium and chromedriver: install both, then try again." >&2
  exit 1
fi
if [ "$(id -u)" -ne 0 ]; then
  echo "The browser tests need chromium and chromedriver. Type this, then try again:" >&2
  echo "  sudo sh -c '$install'" >&2
  exit 1
fi
echo "Installing $packages for the browser tests"
DEBIAN_FRONTEND=noninteractive sh -c "$install" >/dev/null
is_there
