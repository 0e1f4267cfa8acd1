#!/usr/bin/env python3
"""Meshes and surfaces of other people's formats: each becomes a scene that holds 50 Hz, or is refused with a reason.

Usage: foreign_meshes.py BIN_DIR [--quick]. Needs gmsh, and meshio for some (apt install gmsh gmsh-doc meshio-tools);
the demos of gmsh-doc are used where they are installed. Prints a table; ends with 1 where an outcome is not the one
that is written here, with 77 where gmsh is not installed.
"""
import glob
import gzip
import json
import math
import os
import shutil
import struct
import subprocess
import sys
import tempfile

DEMOS = "/usr/share/doc/gmsh-doc"


def sphere(rings, radius, squash=(1, 1, 0.7)):
    """A closed surface of quadrilateral rings, split in triangles."""
    nodes = [(0, 0, -radius)]
    for i in range(1, rings):
        a = math.pi * i / rings - math.pi / 2
        for k in range(2 * rings):
            b = math.pi * k / rings
            nodes.append((radius * math.cos(a) * math.cos(b), radius * math.cos(a) * math.sin(b), radius * math.sin(a)))
    nodes.append((0, 0, radius))
    ring = lambda i, k: 1 + (i - 1) * 2 * rings + k % (2 * rings)
    faces = []
    for k in range(2 * rings):
        faces.append((0, ring(1, k + 1), ring(1, k)))
        faces.append((len(nodes) - 1, ring(rings - 1, k), ring(rings - 1, k + 1)))
        for i in range(1, rings - 1):
            faces.append((ring(i, k), ring(i, k + 1), ring(i + 1, k)))
            faces.append((ring(i, k + 1), ring(i + 1, k + 1), ring(i + 1, k)))
    return [tuple(c * s for c, s in zip(p, squash)) for p in nodes], faces


def write(name, data):
    with open(name, "wb" if isinstance(data, bytes) else "w") as f:
        f.write(data)
    return name


def stl(name, nodes, faces):
    return write(name, "solid organ\n" + "".join(
        "facet normal 0 0 0\nouter loop\n" + "".join("vertex %g %g %g\n" % nodes[i] for i in t) + "endloop\nendfacet\n"
        for t in faces) + "endsolid organ\n")


def binary_stl(name, nodes, faces):
    return write(name, b" " * 80 + struct.pack("<I", len(faces)) + b"".join(
        struct.pack("<12fH", 0, 0, 0, *(c for i in t for c in nodes[i]), 0) for t in faces))


def obj(name, nodes, faces):
    return write(name, "".join("v %g %g %g\n" % p for p in nodes) +
                 "".join("f %d %d %d\n" % tuple(i + 1 for i in t) for t in faces))


def ply(name, nodes, faces):
    return write(name, "ply\nformat ascii 1.0\nelement vertex %d\nproperty float x\nproperty float y\nproperty float z\n"
                 "element face %d\nproperty list uchar int vertex_indices\nend_header\n" % (len(nodes), len(faces)) +
                 "".join("%g %g %g\n" % p for p in nodes) + "".join("3 %d %d %d\n" % t for t in faces))


def by_gmsh(name, geo, *options):
    """A mesh of this geometry."""
    script = write(name + ".geo", geo + "\n")
    subprocess.run(["gmsh", "-3", script, "-o", name, *options], check=True, stdout=subprocess.DEVNULL,
                   stderr=subprocess.DEVNULL)
    return name


def by_meshio(source, name):
    subprocess.run(["meshio", "convert", source, name], check=True, stdout=subprocess.DEVNULL,
                   stderr=subprocess.DEVNULL)
    return name


BALL = ('SetFactory("OpenCASCADE"); Sphere(1) = {0, 0, 0, 0.02}; Physical Volume("liver") = {1};'
        'Mesh.MeshSizeMax = 0.005;')
TORUS = ('SetFactory("OpenCASCADE"); Torus(1) = {0, 0, 0, 0.03, 0.01}; Mesh.MeshSizeMax = 0.006;'
         'Physical Volume("ring") = {1};')
TWO = ('SetFactory("OpenCASCADE"); Box(1) = {0, 0, 0, 0.03, 0.03, 0.01}; Box(2) = {0, 0, 0.01, 0.03, 0.03, 0.01};'
       'BooleanFragments{ Volume{1}; Delete; }{ Volume{2}; Delete; } Mesh.MeshSizeMax = 0.005;'
       'Physical Volume("below") = {1}; Physical Volume("above") = {2};')
HEXES = ('Point(1) = {0, 0, 0, 1}; l[] = Extrude{0.02, 0, 0}{Point{1}; Layers{4};};'
         's[] = Extrude{0, 0.02, 0}{Line{1}; Layers{4}; Recombine;};'
         'v[] = Extrude{0, 0, 0.02}{Surface{s[1]}; Layers{4}; Recombine;}; Physical Volume("cube") = {v[1]};')


def demo(pattern, name):
    found = sorted(glob.glob(DEMOS + "/**/" + pattern, recursive=True))
    if not found:
        return None
    data = gzip.open(found[0]).read() if found[0].endswith(".gz") else open(found[0], "rb").read()
    return write(name, data)


def cases():
    """Name, how its file is made, options of haptic mesh, whether it becomes a scene; or what the refusal says."""
    nodes, faces = sphere(16, 0.02)
    fine_nodes, fine_faces = sphere(60, 0.05)
    yield "ASCII STL", lambda: stl("a.stl", nodes, faces), [], True
    yield "open STL", lambda: stl("open.stl", nodes, faces[:-40]), [], "not closed"
    yield "hexahedra, Gmsh", lambda: by_gmsh("hexes.msh", HEXES), [], "hexahedron"
    yield "Gmsh 1.0", lambda: by_gmsh("one.msh", BALL, "-format", "msh1"), [], True
    yield "binary STL, mm, 14 000 triangles", lambda: binary_stl(
        "b.stl", [tuple(1e3 * c for c in p) for p in fine_nodes], fine_faces), ["--unit", "mm"], True
    yield "OBJ", lambda: obj("c.obj", nodes, faces), [], True
    yield "PLY", lambda: ply("d.ply", nodes, faces), [], True
    yield "VTU", lambda: by_meshio(by_gmsh("e.msh", TORUS, "-format", "msh41"), "e.vtu"), [], True
    yield "DOLFIN XML", lambda: by_meshio(by_gmsh("f.msh", BALL, "-format", "msh41"), "f.xml"), [], True
    yield "Medit", lambda: by_gmsh("g.mesh", BALL), [], True
    yield "two regions, Gmsh binary", lambda: by_gmsh("h.msh", TWO, "-format", "msh22", "-bin"), [], True
    yield "second order, Gmsh", lambda: by_gmsh("i.msh", BALL, "-order", "2", "-format", "msh41"), [], "second-order"
    yield "demo: aneurysm (open)", lambda: demo("aneurysm_data.stl*", "aneurysm.stl"), ["--unit", "mm"], "not closed"
    yield "demo: object", lambda: demo("object.stl*", "object.stl"), ["--unit", "mm"], None
    yield "demo: lever", lambda: demo("lever.stl*", "lever.stl"), ["--unit", "mm"], None


def outcome(program, file, options):
    """(became a scene, what is said of it)."""
    made = subprocess.run([program + "/haptic", "mesh", file, *options, "--scene", "scene.yaml", "--force", "--json",
                           "mesh.json"], capture_output=True, text=True)
    if made.returncode != 0:
        return False, (made.stderr.strip() or made.stdout.strip()).splitlines()[-1]
    checked = subprocess.run([program + "/hapticd", "scene.yaml", "--check", "--json", "plan.json"], capture_output=True,
                             text=True)
    if checked.returncode != 0:
        return False, checked.stderr.strip().splitlines()[-1]
    mesh, plan = json.load(open("mesh.json")), json.load(open("plan.json"))
    text = "%d nodes, %d tetrahedra, felt %.2g N, %.0f N/m" % (
        mesh["nodes"], mesh["tetrahedra"], plan["felt"]["peak_n"], plan["felt"]["stiffness_n_per_m"] or float("nan"))
    return True, text + (", 50 Hz" if plan["on_time"] else ", MISSES 50 Hz")


def main():
    if not shutil.which("gmsh"):
        print("SKIP: gmsh is not installed (apt install gmsh meshio-tools)")
        return 77
    program, quick = os.path.abspath(sys.argv[1]), "--quick" in sys.argv
    wrong = 0
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        for number, (name, make, options, expected) in enumerate(cases()):
            if quick and number >= 4:
                break
            try:
                file = make()
            except FileNotFoundError:
                print("%-34s not made: meshio is not installed" % name)
                continue
            if file is None:
                print("%-34s not made: gmsh-doc is not installed" % name)
                continue
            scene, text = outcome(program, file, options)
            right = (expected is None or (expected is True and scene) or
                     (isinstance(expected, str) and not scene and any(w in text for w in expected.split("|"))))
            wrong += not right
            print("%-34s %-8s %s%s" % (name, "scene" if scene else "refused", text[:240], "" if right else "   <-- WRONG"),
                  flush=True)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
