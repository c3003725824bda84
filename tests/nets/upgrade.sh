#!/usr/bin/env bash
# An upgrade by pip, from the wheel of a commit to that of the checkout: tests/nets/upgrade.sh COMMIT
# After it all entry points load and run, and nothing can be imported that only the old one had; a
# folder that was left behind could be, as a namespace package. Dependencies are those of the Python
# that is first on the path, which needs build, hatchling and pytest; nothing is downloaded.
set -euo pipefail
old=${1:?the commit to upgrade from}
checkout=$(cd "$(dirname "$0")/../.." && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
fail() { printf 'upgrade: %s\n' "$*" >&2; exit 1; }
export HOME=$work/home XDG_CACHE_HOME=$work/home PIP_DISABLE_PIP_VERSION_CHECK=1
unset PYTHONPATH PYTHONDONTWRITEBYTECODE NUMBA_CACHE_DIR

mkdir "$work/old" "$work/home"
git -C "$checkout" archive "$old" | tar -x -C "$work/old"
for which in old new; do
  from=$checkout; if [ $which = old ]; then from=$work/old; fi
  python -m build --wheel --no-isolation --outdir "$work/$which-wheel" "$from" >"$work/build.log" 2>&1 ||
    { cat "$work/build.log" >&2; fail "the $which wheel is not built"; }
  # Modules and packages, by their dotted names.
  python -m zipfile -l "$work/$which-wheel"/*.whl | awk '$1 ~ /^cubepath\/.*\.py$/ {print $1}' |
    sed -E 's#\.py$##; s#/__init__$##' |
    awk -F/ '{for (n = 1; n <= NF; n++) {name = n > 1 ? name "." $n : $n; print name}}' |
    sort -u >"$work/$which-modules"
done

python -m venv "$work/venv"
bin=$work/venv/bin
site=$("$bin/python" -c 'import sysconfig; print(sysconfig.get_path("purelib"))')
python -c 'import sysconfig; print(sysconfig.get_path("purelib"))' >"$site/dependencies.pth"
cd "$work/home"
used() {  # what leaves bytecode and compiled code behind
  test "$("$bin/cubepath" --version)" = "$("$bin/python" -m cubepath --version)" || fail "two versions"
  "$bin/cubepath" run hex:n=3 --log "$1.mcap"
  "$bin/cubepath" verify "$1.mcap"
  "$bin/cubepath" complex polygon:n=6
} >>"$work/used.log" 2>&1
install() { "$bin/python" -m pip install --quiet --no-deps --no-index --force-reinstall "$1"/*.whl; }

install "$work/old-wheel"
used old || { cat "$work/used.log" >&2; fail "the old version does not run"; }
test -n "$(find "$site/cubepath" -name __pycache__)" || fail "no bytecode was kept"
"$bin/python" -m compileall -q "$site/cubepath"
install "$work/new-wheel"
used new || { cat "$work/used.log" >&2; fail "the new version does not run"; }
"$bin/python" -m pip check

comm -23 "$work/old-modules" "$work/new-modules" >"$work/gone"
"$bin/python" - "$work/gone" "$site" <<'PY'
import sys
from importlib.metadata import distribution
from importlib.util import find_spec
from pathlib import Path

def found(name: str) -> bool:
    try:
        return find_spec(name) is not None
    except ModuleNotFoundError:
        return False

found_at = Path(find_spec("cubepath.protocol").origin)
assert found_at.is_relative_to(sys.argv[2]), f"another installation is imported: {found_at}"
points = distribution("cubepath").entry_points
assert {"console_scripts", "pytest11"} <= {point.group for point in points}, points
for point in points:
    point.load()
gone = Path(sys.argv[1]).read_text().split()
left = [name for name in gone if found(name)]
assert not left, f"still to be imported: {', '.join(left)}"
print(f"{len(gone)} modules are gone, {len(points)} entry points load")
PY
echo 'def test_nothing() -> None: ...' >test_nothing.py
"$bin/python" -m pytest -q --trace-config test_nothing.py >pytest.log 2>&1 || { cat pytest.log >&2; fail "pytest"; }
grep -Eq "setuptools registered plugins|cubepath" pytest.log && grep -q 'cubepath.*plugin' pytest.log ||
  { cat pytest.log >&2; fail "pytest does not load the plugin"; }
echo "upgraded from $old"
