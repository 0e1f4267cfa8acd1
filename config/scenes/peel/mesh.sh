#!/bin/sh
# Makes the meshes of this folder from their .geo files with gmsh (4.8): same input, same bytes.
set -eu
cd "$(dirname "$0")"
for body in slab; do
  gmsh -3 -nt 1 -v 2 -format msh41 -o "$body.msh" "$body.geo"
done
