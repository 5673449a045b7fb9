#!/usr/bin/env bash
# Builds the documentation into site/: a warning is an error, and a page that would ask another
# address for anything is refused.
set -euo pipefail
cd "$(dirname "$0")/.."
NO_MKDOCS_2_WARNING=1 .cache/venv-docs/bin/mkdocs --quiet build --clean
rm site/404.html # for servers; it links to their root
loads='<(script|img|iframe|source|video|object|embed)[^>]*(src|data)="?(https?:)?//|<link[^>]*rel="?(stylesheet|preconnect|icon|prefetch|preload)[^>]*href="?(https?:)?//|@import[^;]*//|url\(["'\'']?(https?:)?//'
if grep -rnoE --include='*.html' --include='*.css' "$loads" site; then
  echo "The site would load what is above from another address." >&2
  exit 1
fi
echo "The documentation: site/index.html"
