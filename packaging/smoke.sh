#!/bin/sh
# Builds wheel and source distribution in dist/, checks them, and uses each in a fresh environment.
#   packaging/smoke.sh python3.11 python3.13
set -eu
root=$(cd "$(dirname "$0")/.." && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
"$1" -m venv "$work/build"
"$work/build/bin/pip" install --quiet build twine
rm -rf "$root/dist"
"$work/build/bin/python" -m build --outdir "$root/dist" "$root"
"$work/build/bin/twine" check --strict "$root"/dist/*
for python in "$@"; do
  for file in "$root"/dist/*; do
    rm -rf "$work/env"
    "$python" -m venv "$work/env"
    "$work/env/bin/pip" install --quiet "$file"
    cd "$work"
    env/bin/pyburgers --version
    env/bin/python - <<'PYTHON'
import pathlib
import pyburgers

for name in pyburgers.__all__:
    getattr(pyburgers, name)
shipped = pathlib.Path(pyburgers.__file__).parent / "data" / "ice" / "PIL40.toml"
test = pyburgers.load_experiment(shipped)
print(len(pyburgers.__all__), "public names;", test.id, "has", test.n_points, "points")
PYTHON
    echo "passed: $(basename "$file") with $("$python" --version)"
  done
done
