#!/usr/bin/env bash
# Builds dist/prooflight_VERSION_ARCH.deb: a virtual environment in /opt/prooflight with all packages and what they need,
# the services of systemd, a user, and `prooflight` on the path. Needs dpkg-deb, and a Python of the same minor version as
# the system on which it is installed.
set -euo pipefail
cd "$(dirname "$0")/.."
PYTHON=${PYTHON:-/usr/bin/python3}
SITE=/opt/prooflight
version=$(sed -n 's/^version = "\(.*\)"/\1/p' pyproject.toml | head -1)
minor=$("$PYTHON" -c 'import sys; print(sys.version_info.minor)')
arch=$(dpkg --print-architecture)
stage=$(mktemp -d)
trap 'rm -rf "$stage"' EXIT

echo "installing into a virtual environment of $("$PYTHON" --version)"
"$PYTHON" -m venv --copies --without-pip "$stage$SITE"
sed -n '/^[a-zA-Z0-9].*==/s/ *\\$//p' requirements/dev.txt > "$stage/constraints.txt"
"$PYTHON" -m venv "$stage/pip"
"$stage/pip/bin/pip" --quiet --disable-pip-version-check --python "$stage$SITE/bin/python" install --no-compile \
  --constraint "$stage/constraints.txt" ".[pdf,demo]" "packages/line[plant,hot-folder,records,otel]" "packages/console[oidc]"

# The environment was made elsewhere than where it will lie: programs and its own record of its place are corrected.
ln --symbolic --force /usr/bin/python3 "$stage$SITE/bin/python3"
ln --symbolic --force python3 "$stage$SITE/bin/python"
rm -f "$stage$SITE"/bin/python3.* "$stage$SITE"/bin/[Aa]ctivate*
grep --recursive --files-with-matches --fixed-strings "$stage" "$stage$SITE/bin" "$stage$SITE/pyvenv.cfg" |
  xargs --no-run-if-empty sed --in-place "s#$stage##g"
find "$stage$SITE" -name __pycache__ -prune -exec rm -r {} +

root=$stage/root
mkdir -p "$root/DEBIAN" "$root/opt" "$root/lib/systemd/system" "$root/usr/bin" "$root/etc/prooflight"
mv "$stage$SITE" "$root/opt/"
mv "$root$SITE"/share/prooflight/*.service "$root/lib/systemd/system/"
ln --symbolic "$SITE/bin/prooflight" "$root/usr/bin/prooflight"
cat > "$root/DEBIAN/control" <<CONTROL
Package: prooflight
Version: $version
Architecture: $arch
Maintainer: The Prooflight developers <prooflight@localhost>
Installed-Size: $(du --summarize --block-size=1K "$root" | cut -f1)
Depends: python3 (>= 3.$minor), python3 (<< 3.$((minor + 1))), adduser
Recommends: libaravis-0.8-0
Section: graphics
Priority: optional
Description: inspection of digital presses while they print
 Prooflight predicts from the page's own raster what a line camera over the
 paper must see, compares, and decides: pass or stop. It comes with the
 services for a press, its console and the records of many presses.
CONTROL
cat > "$root/DEBIAN/postinst" <<'SCRIPT'
#!/bin/sh
set -e
if [ "$1" = configure ]; then
  adduser --system --group --quiet --home /var/lib/prooflight --no-create-home prooflight
  [ ! -d /run/systemd/system ] || systemctl daemon-reload
fi
SCRIPT
cat > "$root/DEBIAN/prerm" <<'SCRIPT'
#!/bin/sh
set -e
# An upgrade leaves runs alone: a press that prints goes on with the program that it began with.
if [ "$1" = remove ] && [ -d /run/systemd/system ]; then
  systemctl stop 'prooflight-*' || true
fi
# What Python compiled beside the modules belongs to no package.
find /opt/prooflight -name __pycache__ -prune -exec rm -r {} + || true
SCRIPT
chmod 755 "$root/DEBIAN/postinst" "$root/DEBIAN/prerm"
mkdir -p dist
dpkg-deb --root-owner-group -Zgzip -z3 --build "$root" "dist/prooflight_${version}_$arch.deb"
