#!/bin/sh
# The cataract scene's lens (../cataract/lens.geo) with coarser elements, with gmsh 4.8; binary MSH 2.2.
set -eu
cd "$(dirname "$0")"
gmsh -3 -nt 1 -v 2 -bin -format msh22 -setnumber skin 0.88 -setnumber core 0.69 -o lens_400.msh \
  ../cataract/lens.geo
