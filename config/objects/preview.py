#!/usr/bin/env python3
"""Draws one sheet with a picture of each object file: preview.py OUT.png FILE[:Q,...]...

Q are the coordinates of the object's joints (rad or m), for example drawer.object.json:0.15. Software z-buffer, 2 x 2
samples per pixel. Needs only Python's standard library.
"""
import json
import math
import struct
import sys
import zlib

WIDTH, HEIGHT, COLUMNS, SAMPLES = 320, 280, 4, 2
COLOURS = [(0.52, 0.66, 0.80), (0.87, 0.62, 0.42), (0.60, 0.76, 0.55)]
LIGHT = (-0.35, 0.75, 0.56)


def rotate(q, v):
    x, y, z, w = q
    t = [2 * (y * v[2] - z * v[1]), 2 * (z * v[0] - x * v[2]), 2 * (x * v[1] - y * v[0])]
    return (v[0] + w * t[0] + y * t[2] - z * t[1], v[1] + w * t[1] + z * t[0] - x * t[2],
            v[2] + w * t[2] + x * t[1] - y * t[0])


def place(pose, v):
    v = rotate(pose["orientation"], v)
    return tuple(v[k] + pose["position"][k] for k in range(3))


def place_back(pose, v):
    x, y, z, w = pose["orientation"]
    return rotate((-x, -y, -z, w), tuple(v[k] - pose["position"][k] for k in range(3)))


def triangles(model, coordinates):
    """Triangles in the frame of the first link, with the index of their link."""
    links = {link["name"]: i for i, link in enumerate(model["links"])}
    chains = {0: []}
    for number, joint in enumerate(model["joints"]):
        q = coordinates[number] if number < len(coordinates) else 0
        move = {"position": [0, 0, 0], "orientation": [0, 0, 0, 1]}
        if joint["kind"] in ("hinge", "screw"):
            move["orientation"] = [0, math.sin(q / 2), 0, math.cos(q / 2)]
        if joint["kind"] in ("slider", "screw"):
            move["position"] = [0, q * joint.get("pitch", 2 * math.pi) / (2 * math.pi), 0]
        chains[links[joint["child"]]] = chains[links[joint["parent"]]] + [(joint, move)]
    for index, link in enumerate(model["links"]):
        points = list(zip(*[iter(link["vertices"])] * 3))
        for joint, move in reversed(chains[index]):
            points = [place(joint["parent_from_joint"], place(move, place_back(joint["child_from_joint"], p)))
                      for p in points]
        for t in zip(*[iter(link["triangles"])] * 3):
            yield index, [points[i] for i in t]


def unit(v):
    length = math.sqrt(sum(x * x for x in v)) or 1
    return tuple(x / length for x in v)


def render(model, coordinates):
    wide, high = WIDTH * SAMPLES, HEIGHT * SAMPLES
    turn, tilt = math.radians(-32), math.radians(28)

    def view(p):
        x, z = p[0] * math.cos(turn) + p[2] * math.sin(turn), p[2] * math.cos(turn) - p[0] * math.sin(turn)
        return x, p[1] * math.cos(tilt) - z * math.sin(tilt), p[1] * math.sin(tilt) + z * math.cos(tilt)

    shapes = [(index, [view(p) for p in t]) for index, t in triangles(model, coordinates)]
    low = [min(p[k] for _, t in shapes for p in t) for k in range(2)]
    top = [max(p[k] for _, t in shapes for p in t) for k in range(2)]
    scale = 0.86 * min(wide / (top[0] - low[0]), high / (top[1] - low[1]))
    depth = [-1e9] * (wide * high)
    image = [(0.97, 0.97, 0.97)] * (wide * high)
    light = unit(LIGHT)
    for index, t in shapes:
        middle = [(low[k] + top[k]) / 2 for k in range(2)]
        p = [(wide / 2 + scale * (v[0] - middle[0]), high / 2 - scale * (v[1] - middle[1]), v[2]) for v in t]
        area = (p[1][0] - p[0][0]) * (p[2][1] - p[0][1]) - (p[2][0] - p[0][0]) * (p[1][1] - p[0][1])
        if area >= 0:  # seen from behind
            continue
        a, b = [tuple(t[k][i] - t[0][i] for i in range(3)) for k in (1, 2)]
        n = unit((a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]))
        shade = 0.35 + 0.65 * max(0, sum(n[k] * light[k] for k in range(3)))
        colour = tuple(shade * c for c in COLOURS[index % len(COLOURS)])
        for y in range(max(0, math.floor(min(v[1] for v in p))), min(high, math.ceil(max(v[1] for v in p)) + 1)):
            for x in range(max(0, math.floor(min(v[0] for v in p))), min(wide, math.ceil(max(v[0] for v in p)) + 1)):
                u = ((x - p[0][0]) * (p[2][1] - p[0][1]) - (p[2][0] - p[0][0]) * (y - p[0][1])) / area
                w = ((p[1][0] - p[0][0]) * (y - p[0][1]) - (x - p[0][0]) * (p[1][1] - p[0][1])) / area
                if u < 0 or w < 0 or u + w > 1:
                    continue
                z = p[0][2] + u * (p[1][2] - p[0][2]) + w * (p[2][2] - p[0][2])
                if z > depth[y * wide + x]:
                    depth[y * wide + x] = z
                    image[y * wide + x] = colour
    rows = []
    for y in range(HEIGHT):
        row = []
        for x in range(WIDTH):
            cells = [image[(SAMPLES * y + j) * wide + SAMPLES * x + i] for j in range(SAMPLES) for i in range(SAMPLES)]
            row.append(tuple(int(255 * sum(c[k] for c in cells) / len(cells)) for k in range(3)))
        rows.append(row)
    return rows


def save_png(path, rows):
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    raw = b"".join(b"\0" + bytes(value for pixel in row for value in pixel) for row in rows)
    with open(path, "wb") as out:
        out.write(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", len(rows[0]), len(rows), 8, 2, 0, 0, 0))
                  + chunk(b"IDAT", zlib.compress(raw, 9)) + chunk(b"IEND", b""))


def main():
    pictures = []
    for argument in sys.argv[2:]:
        path, _, values = argument.partition(":")
        with open(path, encoding="utf-8") as file:
            model = json.load(file)
        pictures.append(render(model, [float(v) for v in values.split(",") if v]))
    while len(pictures) % COLUMNS:
        pictures.append([[(247, 247, 247)] * WIDTH] * HEIGHT)
    rows = []
    for first in range(0, len(pictures), COLUMNS):
        for y in range(HEIGHT):
            rows.append([pixel for picture in pictures[first:first + COLUMNS] for pixel in picture[y]])
    save_png(sys.argv[1], rows)


if __name__ == "__main__":
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    main()
