#!/usr/bin/env python3
"""Makes the object files of this folder: make_objects.py BUILDER [NAME...] [--out FOLDER].

BUILDER is the program softhand-build-object. Without names it makes all objects. Writes closed OBJ meshes and a
description of each object to a temporary folder, and the object files to FOLDER, by default the folder of this script.
Lengths are in m. Needs only Python's standard library.
"""
import argparse
import json
import math
import os
import subprocess
import tempfile

NOTICE = "Made by config/objects/make_objects.py of softhand; under the licence of softhand"


class Mesh:
    """A closed, outward triangle mesh."""

    def __init__(self):
        self.vertices, self.faces = [], []

    def add(self, vertex):
        self.vertices.append(tuple(vertex))
        return len(self.vertices) - 1

    def quad(self, a, b, c, d):
        self.faces += [(a, b, c), (a, c, d)]

    def join_rings(self, rings):
        """Quads between rings of indices that follow each other; a ring of one index is a point."""
        for lower, upper in zip(rings, rings[1:]):
            count = max(len(lower), len(upper))
            for k in range(count):
                a, b = lower[k % len(lower)], lower[(k + 1) % len(lower)]
                c, d = upper[(k + 1) % len(upper)], upper[k % len(upper)]
                if a != b:
                    self.faces.append((a, b, c))
                if c != d:
                    self.faces.append((a, c, d))

    def moved(self, move=(0, 0, 0), turn=None):
        """The mesh turned by a function of a point, then moved."""
        out = Mesh()
        out.faces = self.faces
        for v in self.vertices:
            v = turn(v) if turn else v
            out.vertices.append(tuple(v[k] + move[k] for k in range(3)))
        return out

    def volume(self):
        total = 0
        for a, b, c in (tuple(self.vertices[i] for i in f) for f in self.faces):
            total += (a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2])
                      + a[2] * (b[0] * c[1] - b[1] * c[0])) / 6
        return total

    def save(self, path):
        faces = self.faces if self.volume() > 0 else [(a, c, b) for a, b, c in self.faces]
        with open(path, "w", encoding="utf-8") as out:
            for v in self.vertices:
                out.write("v %.7f %.7f %.7f\n" % v)
            for f in faces:
                out.write("f %d %d %d\n" % tuple(i + 1 for i in f))


def arc(centre, radius, start, end, parts):
    """Points of a circle in the plane, angles in degrees."""
    angles = [math.radians(start + (end - start) * i / parts) for i in range(parts + 1)]
    return [(centre[0] + radius * math.cos(a), centre[1] + radius * math.sin(a)) for a in angles]


def divided(profile, longest):
    """A profile whose long edges are divided."""
    out = [profile[0]]
    for a, b in zip(profile, profile[1:]):
        parts = max(1, math.ceil(math.dist(a, b) / longest))
        out += [(a[0] + (b[0] - a[0]) * i / parts, a[1] + (b[1] - a[1]) * i / parts) for i in range(1, parts + 1)]
    return out


def lathe(profile, count, radius=lambda r, y, angle: r, closed=False):
    """Turns a profile of (radius, y) about y. It starts and ends on the axis, or is closed."""
    mesh, rings = Mesh(), []
    for r, y in profile:
        if r < 1e-9:
            rings.append([mesh.add((0, y, 0))])
            continue
        ring = []
        for k in range(count):
            angle = 2 * math.pi * k / count
            here = radius(r, y, angle)
            ring.append(mesh.add((here * math.sin(angle), y, here * math.cos(angle))))
        rings.append(ring)
    mesh.join_rings(rings + rings[:1] if closed else rings)
    return mesh


def subtract(a, b):
    return tuple(x - y for x, y in zip(a, b))


def cross(a, b):
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def unit(a):
    length = math.sqrt(sum(x * x for x in a))
    return tuple(x / length for x in a)


def sweep(path, across, up_radius, side_radius, count=16, closed=False):
    """A tube with an elliptic section along a path. `across` is a direction that is never along the path. The ends of
    an open path are flat."""
    mesh, rings = Mesh(), []
    size = len(path)
    for i, point in enumerate(path):
        before, after = (i - 1, (i + 1) % size) if closed else (max(0, i - 1), min(size - 1, i + 1))
        tangent = unit(subtract(path[after], path[before]))
        side = unit(cross(tangent, across))
        up = cross(side, tangent)
        ring = []
        for k in range(count):
            c, s = math.cos(2 * math.pi * k / count), math.sin(2 * math.pi * k / count)
            ring.append(mesh.add(tuple(point[j] + side_radius * c * side[j] + up_radius * s * up[j] for j in range(3))))
        rings.append(ring)
    if closed:
        mesh.join_rings(rings + rings[:1])
    else:
        mesh.join_rings([[mesh.add(path[0])]] + rings + [[mesh.add(path[-1])]])
    return mesh


def rounded_box(half, radius, parts=3, flat=None):
    """A box with round edges. `flat` is the longest edge of a triangle on the flat faces."""
    steps = [45 * i / parts for i in range(parts + 1)]
    inner = [h - radius for h in half]

    def line(axis):
        middle = 1 if flat is None else max(1, math.ceil(2 * inner[axis] / flat))
        return ([(-a, -inner[axis]) for a in reversed(steps)]
                + [(0, inner[axis] * (2 * i / middle - 1)) for i in range(1, middle)]
                + [(a, inner[axis]) for a in steps])

    mesh, found = Mesh(), {}

    def vertex(p):
        key = tuple(round(x * 1e8) for x in p)
        if key not in found:
            found[key] = mesh.add(p)
        return found[key]

    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for sign in (-1, 1):
            grid = []
            for angle_u, offset_u in line(u):
                row = []
                for angle_v, offset_v in line(v):
                    d = [0, 0, 0]
                    d[axis], d[u], d[v] = sign, math.tan(math.radians(angle_u)), math.tan(math.radians(angle_v))
                    d = unit(d)
                    p = [radius * x for x in d]
                    p[axis] += sign * inner[axis]
                    p[u] += offset_u
                    p[v] += offset_v
                    row.append(vertex(p))
                grid.append(row)
            for i in range(len(grid) - 1):
                for j in range(len(grid[0]) - 1):
                    corners = [grid[i][j], grid[i + 1][j], grid[i + 1][j + 1], grid[i][j + 1]]
                    mesh.quad(*(corners if sign > 0 else reversed(corners)))
    return mesh


def prism(outline, low, high):
    """A polygon in the plane z = 0, seen counter-clockwise from +z and star-shaped about its centre, between two z."""
    mesh = Mesh()
    centre = [sum(p[k] for p in outline) / len(outline) for k in range(2)]
    mesh.join_rings([[mesh.add((*centre, low))], [mesh.add((*p, low)) for p in outline],
                     [mesh.add((*p, high)) for p in outline], [mesh.add((*centre, high))]])
    return mesh


def link(name, meshes, friction, spacing, **mass):
    return {"name": name, "meshes": meshes, "friction": friction, "spacing": spacing, **mass}


def mug():
    # Ceramic, 80 mm wide, 95 mm high, wall 4 mm. The handle leaves 29 mm for the fingers.
    profile = ([(0, 0)] + arc((0.037, 0.003), 0.003, -90, 0, 3) + arc((0.038, 0.093), 0.002, 0, 180, 6)
               + arc((0.032, 0.009), 0.004, 0, -90, 4) + [(0, 0.005)])
    body = lathe(divided(profile, 0.010), 48)
    path = ([(0.038, 0.022, 0), (0.046, 0.022, 0)] + [(x, y, 0) for x, y in arc((0.052, 0.042), 0.020, -80, -5, 6)]
            + [(x, y, 0) for x, y in arc((0.052, 0.056), 0.020, 5, 80, 6)] + [(0.046, 0.076, 0), (0.038, 0.076, 0)])
    handle = sweep(path, (0, 0, 1), 0.007, 0.0045, 16)
    return {"links": [link("mug", [body, handle], 0.5, 0.001, density=2400)]}


def bottle():
    # A closed bottle full of water: the body is solid. 66 mm wide, 210 mm high with its cap.
    body = lathe(divided([(0, 0)] + arc((0.029, 0.004), 0.004, -90, 0, 3) + [(0.033, 0.130)]
                         + arc((0.023, 0.150), 0.010, 0, 60, 4) + [(0.0135, 0.176), (0.0135, 0.180)]
                         + arc((0.0155, 0.1815), 0.0015, 270, 360, 2) + arc((0.0155, 0.1845), 0.0015, 0, 90, 2)
                         + [(0.0130, 0.187), (0.0130, 0.2035)] + [(0.0120, 0.2045), (0, 0.2045)], 0.012), 40)
    # The cap: wall 3 mm, 0.6 mm from the neck, 24 ridges.
    ridge = lambda r, y, angle: r + (0.0004 * math.cos(24 * angle) if r > 0.0155 and 0.1885 < y < 0.209 else 0)
    cap = lathe(divided([(0, 0.2052)] + [(0.0136, 0.2052), (0.0136, 0.188)] + [(0.0160, 0.188), (0.0168, 0.189)]
                        + [(0.0168, 0.2078), (0.0158, 0.2088), (0, 0.2088)], 0.012), 96, ridge)
    screw = {"kind": "screw", "parent": "body", "child": "cap", "origin": [0, 0.188, 0], "axis": [0, 1, 0],
             "pitch": 0.004, "minimum": 0, "maximum": 18.85, "friction": 0.1, "damping": 0.002}
    return {"links": [link("body", [body], 0.5, 0.0015, mass=0.52), link("cap", [cap], 0.6, 0.001, mass=0.004)],
            "joints": [screw]}


def scissors():
    # 190 mm long, blades 3 mm thick. The loops are 30 x 45 mm inside. Closed at q = 0.
    def half(side):
        low, high = (0.0001, 0.0031) if side > 0 else (-0.0031, -0.0001)
        z = 0.5 * (low + high)
        # Seen from +z, the blade of the half with the right loop is on the left of the cut.
        outline = [(-0.009, -0.012), (0.007, -0.012), (0.007, 0.010), (0.002, 0.030), (0.002, 0.098), (-0.001, 0.099),
                   (-0.006, 0.070), (-0.009, 0.030)]
        blade = prism(outline, low, high)
        loop = sweep([(0.024 + 0.019 * math.cos(a), -0.067 + 0.0265 * math.sin(a), z)
                      for a in (2 * math.pi * k / 40 for k in range(40))], (0, 0, 1), 0.004, 0.004, 12, closed=True)
        shank = sweep([(-0.001, -0.004, z), (0.000, -0.014, z), (0.003, -0.026, z), (0.008, -0.036, z),
                       (0.013, -0.0435, z)], (0, 0, 1), 0.00145, 0.0050, 12)
        parts = [blade, shank, loop]
        if side < 0:
            parts = [p.moved(turn=lambda v: (-v[0], v[1], v[2])) for p in parts]
        return parts

    hinge = {"kind": "hinge", "parent": "left", "child": "right", "origin": [0, 0, 0], "axis": [0, 0, 1],
             "minimum": 0, "maximum": 1.2, "friction": 0.01, "damping": 0.0005}
    return {"links": [link("left", half(-1), 0.4, 0.0008, mass=0.045), link("right", half(1), 0.4, 0.0008, mass=0.045)],
            "joints": [hinge]}


def drawer():
    # Housing 300 x 124 x 340 mm of 12 mm board, open at the front (+z). The tray slides 240 mm out.
    def board(size, centre, radius=0.002):
        return rounded_box([0.5 * s for s in size], radius, 2).moved(centre)

    housing = [board((0.300, 0.012, 0.340), (0, -0.056, 0)), board((0.300, 0.012, 0.340), (0, 0.056, 0)),
               board((0.012, 0.119, 0.338), (-0.144, 0, 0)), board((0.012, 0.119, 0.338), (0.144, 0, 0)),
               board((0.296, 0.117, 0.012), (0, 0, -0.163))]
    tray = [board((0.268, 0.010, 0.312), (0, -0.042, 0.002)), board((0.010, 0.080, 0.310), (-0.129, -0.007, 0.002)),
            board((0.010, 0.080, 0.310), (0.129, -0.007, 0.002)), board((0.262, 0.074, 0.010), (0, -0.009, -0.1465)),
            board((0.296, 0.120, 0.016), (0, 0, 0.1795), 0.003)]
    bow = ([(-0.055, 0, 0.183), (-0.055, 0, 0.205)] + [(x, 0, z) for x, z in arc((-0.043, 0.210), 0.012, 180, 90, 4)]
           + [(x, 0, z) for x, z in arc((0.043, 0.210), 0.012, 90, 0, 4)] + [(0.055, 0, 0.205), (0.055, 0, 0.183)])
    tray.append(sweep(bow, (0, 1, 0), 0.005, 0.005, 16))
    slider = {"kind": "slider", "parent": "housing", "child": "tray", "origin": [0, -0.042, 0], "axis": [0, 0, 1],
              "minimum": 0, "maximum": 0.240, "friction": 3, "damping": 4,
              "detents": [{"at": 0, "depth": 0.006, "width": 0.006, "period": 0}]}
    return {"links": [link("housing", housing, 0.4, 0.003, density=650), link("tray", tray, 0.4, 0.002, density=650)],
            "joints": [slider]}


def button():
    # A round housing of 70 mm with a button of 30 mm. Stroke 5 mm. Preload 1.6 N, 5.6 N at the end, and a dome of 1 N.
    housing = lathe(divided([(0, 0)] + arc((0.033, 0.002), 0.002, -90, 0, 2) + arc((0.032, 0.027), 0.003, 0, 90, 3)
                            + arc((0.0170, 0.029), 0.001, 90, 180, 2) + [(0.016, 0.008), (0, 0.008)], 0.010), 48)
    cap = lathe(divided([(0, 0.014)] + [(0.0140, 0.014), (0.015, 0.015)] + arc((0.012, 0.035), 0.003, 0, 90, 4)
                        + [(0, 0.038)], 0.008), 48)
    slider = {"kind": "slider", "parent": "housing", "child": "button", "origin": [0, 0.014, 0], "axis": [0, 1, 0],
              "minimum": -0.005, "maximum": 0, "friction": 0.1, "damping": 0.5, "stiffness": 800, "rest": 0.002,
              "detents": [{"at": -0.0025, "depth": -0.00087, "width": 0.0015, "period": 0}]}
    links = [link("housing", [housing], 0.5, 0.001, mass=0.120), link("button", [cap], 0.6, 0.001, mass=0.012)]
    return {"links": links, "joints": [slider]}


def key():
    # Brass, 2.5 mm thick, 57 mm long.
    ring = lathe([(0.0035, -0.00095), (0.0038, -0.00125), (0.0117, -0.00125), (0.0120, -0.00095), (0.0120, 0.00095),
                  (0.0117, 0.00125), (0.0038, 0.00125), (0.0035, 0.00095)], 40, closed=True)
    bow = ring.moved(turn=lambda v: (v[0], -v[2], v[1]))
    shaft = prism([(-0.004, -0.045), (-0.001, -0.045), (0.004, -0.040), (0.004, -0.007), (-0.004, -0.007)],
                  -0.0012, 0.0012)
    teeth = [prism([(-0.0062, y - 0.0035), (-0.0012, y - 0.0045), (-0.0012, y + 0.0045), (-0.0062, y + 0.0012)],
                   -0.00115, 0.00115) for y in (-0.022, -0.031, -0.0395)]
    return {"links": [link("key", [bow, shaft, *teeth], 0.4, 0.0006, density=8500)]}


def pen():
    profile = ([(0, 0)] + arc((0, 0.0006), 0.0006, -60, 0, 2) + [(0.0012, 0.005), (0.0022, 0.0052), (0.0048, 0.020)]
               + [(0.0052, 0.024), (0.0052, 0.130)] + arc((0.0032, 0.143), 0.002, 0, 90, 3) + [(0, 0.145)])
    return {"links": [link("pen", [lathe(divided(profile, 0.006), 24)], 0.5, 0.0006, density=1050)]}


def die():
    return {"links": [link("die", [rounded_box([0.008] * 3, 0.002, 4)], 0.5, 0.0006, density=1180)]}


def sponge_ball():
    radius = 0.025
    profile = [(radius * math.sin(a), -radius * math.cos(a)) for a in (math.pi * k / 24 for k in range(25))]
    profile[0], profile[-1] = (0, -radius), (0, radius)
    return {"soft": {"mesh": lathe(profile, 48), "nodes": 500, "density": 60, "youngs_modulus": 5e3,
                     "poisson_ratio": 0.2, "strain_limit_energy": 400, "strain_limit_stiffness": 400,
                     "friction": 0.8}}


def soft_cup():
    # Foamed silicone, 56 mm wide, 60 mm high, wall and bottom 5 mm.
    profile = divided([(0, 0)] + arc((0.025, 0.003), 0.003, -90, 0, 4) + arc((0.0255, 0.0575), 0.0025, 0, 180, 6)
                      + arc((0.021, 0.007), 0.002, 0, -90, 3) + [(0, 0.005)], 0.005)
    return {"soft": {"mesh": lathe(profile, 48), "nodes": 1000, "density": 500, "youngs_modulus": 3e5,
                     "poisson_ratio": 0.3, "strain_limit_energy": 4000, "strain_limit_stiffness": 400,
                     "friction": 0.8}}


OBJECTS = {f.__name__: f for f in (mug, bottle, scissors, drawer, button, key, pen, die, sponge_ball, soft_cup)}


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("builder", help="the program softhand-build-object")
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"objects to make: {', '.join(OBJECTS)}; default: all")
    parser.add_argument("--out", default=os.path.dirname(os.path.abspath(__file__)), metavar="FOLDER")
    options = parser.parse_intermixed_args()
    unknown = [name for name in options.names if name not in OBJECTS]
    if unknown:
        parser.error(f"unknown object {unknown[0]}; expected one of {', '.join(OBJECTS)}")
    with tempfile.TemporaryDirectory() as folder:
        for name in options.names or OBJECTS:
            description = {"name": name, "notice": NOTICE, **OBJECTS[name]()}
            if "soft" in description:
                mesh, file = description["soft"]["mesh"], name + ".obj"
                mesh.save(os.path.join(folder, file))
                description["soft"]["mesh"] = file
            for part in description.get("links", []):
                files = []
                for number, mesh in enumerate(part["meshes"]):
                    files.append(f"{name}_{part['name']}_{number}.obj")
                    mesh.save(os.path.join(folder, files[-1]))
                part["meshes"] = files
            path = os.path.join(folder, name + ".json")
            with open(path, "w", encoding="utf-8") as out:
                json.dump(description, out, indent=1)
            output = os.path.join(options.out, name + ".object.json")
            subprocess.run([options.builder, path, "--output", output], check=True)


if __name__ == "__main__":
    main()
