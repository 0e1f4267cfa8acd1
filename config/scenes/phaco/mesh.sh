#!/bin/sh
# Makes the mesh of this folder from its .geo file with gmsh (4.8): same input, same bytes.
set -eu
cd "$(dirname "$0")"
gmsh -3 -nt 1 -v 2 -format msh41 -o nucleus.msh nucleus.geo
