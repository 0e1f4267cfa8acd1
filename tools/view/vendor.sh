#!/usr/bin/env bash
# Brings three.js into page/vendor at the version named here, from the npm registry: the minified modules, the orbit
# controls and the licence, unchanged but for the name by which the controls import the module. The files are kept in the
# repository; the page needs no network.
# Example: tools/view/vendor.sh
set -euo pipefail
version=0.180.0
sha512=a3eab2700319ae1f93b04d351aa594c5420a47500bd12f29abbcc3918390c3c1aa7d7f1bf15a022985281db8625f98feee1afc5ecb870d553afa09102502a0f7
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

cd "$work"
npm pack "three@$version" --silent >/dev/null
echo "$sha512  three-$version.tgz" | sha512sum --check --quiet
tar xzf "three-$version.tgz"
vendor=$here/page/vendor
mkdir -p "$vendor"
cp package/build/three.core.min.js package/build/three.module.min.js "$vendor/"
sed "s#from 'three'#from './three.module.min.js'#" package/examples/jsm/controls/OrbitControls.js >"$vendor/OrbitControls.js"
cp package/LICENSE "$vendor/three.LICENSE"
