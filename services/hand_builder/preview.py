#!/usr/bin/env python3
"""Draws pictures of a hand from the OBJ file of softhand-build-hand: preview.py hand.obj out.png [surface|skin].

Software z-buffer. Needs only numpy and matplotlib."""
import sys
import numpy as np
import matplotlib.image


def read(path, group):
    vertices, faces, current = [], [], None
    for line in open(path):
        w = line.split()
        if w[0] == "v":
            vertices.append([float(x) for x in w[1:4]])
        elif w[0] == "g":
            current = w[1]
        elif w[0] == "f" and current == group:
            faces.append([int(x) - 1 for x in w[1:4]])
    return np.array(vertices), np.array(faces)


def render(v, f, right, up, flat, size=520):
    right = np.array(right, float) / np.linalg.norm(right)
    toward = np.cross(right, up)
    toward /= np.linalg.norm(toward)
    up = np.cross(toward, right)
    p = v @ np.array([right, up, toward]).T
    used = p[np.unique(f)]
    centre = 0.5 * (used[:, :2].min(0) + used[:, :2].max(0))
    scale = size * 0.92 / 0.26
    xy = (p[:, :2] - centre) * scale * [1, -1] + size / 2
    normal = np.cross(p[f[:, 1]] - p[f[:, 0]], p[f[:, 2]] - p[f[:, 0]])
    vertex_normal = np.zeros_like(p)
    for k in range(3):
        np.add.at(vertex_normal, f[:, k], normal)
    vertex_normal /= np.linalg.norm(vertex_normal, axis=1, keepdims=True) + 1e-30
    image = np.full((size, size, 3), 0.97)
    depth = np.full((size, size), -1e9)
    light = np.array([-0.35, 0.5, 0.8]) / np.linalg.norm([-0.35, 0.5, 0.8])
    for i, t in enumerate(f):
        if normal[i, 2] <= 0:
            continue
        a, b, c = xy[t]
        lo = np.maximum(np.floor(np.minimum(np.minimum(a, b), c)), 0).astype(int)
        hi = np.minimum(np.ceil(np.maximum(np.maximum(a, b), c)), size - 1).astype(int)
        x, y = np.meshgrid(np.arange(lo[0], hi[0] + 1), np.arange(lo[1], hi[1] + 1))
        d = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])
        if abs(d) < 1e-12:
            continue
        u = ((x - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (y - a[1])) / d
        w = ((b[0] - a[0]) * (y - a[1]) - (x - a[0]) * (b[1] - a[1])) / d
        z = p[t[0], 2] + u * (p[t[1], 2] - p[t[0], 2]) + w * (p[t[2], 2] - p[t[0], 2])
        inside = (u >= -1e-9) & (w >= -1e-9) & (u + w <= 1 + 1e-9)
        block = (slice(lo[1], hi[1] + 1), slice(lo[0], hi[0] + 1))
        front = inside & (z > depth[block])
        n = (vertex_normal[t[0]] * (1 - u - w)[..., None] + vertex_normal[t[1]] * u[..., None]
             + vertex_normal[t[2]] * w[..., None])
        if flat:
            n = np.broadcast_to(normal[i], n.shape)
        n = n / (np.linalg.norm(n, axis=-1, keepdims=True) + 1e-30)
        shade = 0.28 + 0.72 * np.clip(n @ light, 0, 1)
        image[block][front] = (shade[..., None] * [0.93, 0.74, 0.63])[front]
        depth[block][front] = z[front]
    return image


if __name__ == "__main__":
    group = sys.argv[3] if len(sys.argv) > 3 else "skin"
    v, f = read(sys.argv[1], group)
    views = [([1, 0, 0], [0, 0, -1]), ([-1, 0, 0], [0, 0, -1]), ([0, 0, -1], [0, 1, 0]), ([0.75, 0.1, -0.6], [0, 1, 0])]
    pictures = [render(v, f, r, u, group == "surface") for r, u in views]
    matplotlib.image.imsave(sys.argv[2], np.vstack([np.hstack(pictures[:2]), np.hstack(pictures[2:])]))
