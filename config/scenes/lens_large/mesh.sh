#!/bin/sh
# The cataract scene's lens (../cataract/lens.geo) with finer elements, with gmsh 4.8; binary MSH 2.2, the
# smallest. Sizes of elements at the surface and in the middle in mm; about nodes^(-1/3). With the argument
# 100k: lens_100k.msh alone, 25 MB, for `haptic chart step --lenses 100k`; not in the repository.
set -eu
cd "$(dirname "$0")"
make_lens() {
  gmsh -3 -nt 1 -v 2 -bin -format msh22 -setnumber skin "$2" -setnumber core "$3" -o "$1.msh" \
    ../cataract/lens.geo
}
if [ "${1:-}" = 100k ]; then
  make_lens lens_100k 0.1203 0.0942
  exit
fi
make_lens lens_5k 0.352 0.273
make_lens lens_10k 0.2785 0.2160
make_lens lens_20k 0.2104 0.1647
