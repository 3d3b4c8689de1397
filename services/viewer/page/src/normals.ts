// Normals of a triangle mesh that is smooth but for its sharp edges. Without three.js, whose toCreasedNormals takes
// all places within a centimetre for one, and a small object lies within it.

/**
 * One position and one normal (3 values each) for each corner of each triangle. The triangles around a vertex share
 * their mean normal, weighted by area, as far as they are connected by edges that bend by less than `crease` (rad).
 * `triangles` are indices of `vertices`. Vertices at the same place are different vertices. The time is linear.
 */
export function creasedNormals(
  vertices: Float32Array,
  triangles: Uint32Array,
  crease: number,
): { positions: Float32Array; normals: Float32Array } {
  const corners = triangles.length;
  const positions = new Float32Array(3 * corners);
  for (let c = 0; c < corners; ++c)
    for (let d = 0; d < 3; ++d) positions[3 * c + d] = vertices[3 * triangles[c]! + d]!;

  // Twice the area of each triangle times its normal.
  const faces = new Float64Array(corners);
  for (let c = 0; c < corners; c += 3) {
    const edge = (to: number, d: number): number => positions[3 * (c + to) + d]! - positions[3 * c + d]!;
    for (let d = 0; d < 3; ++d) {
      const [e, f] = [(d + 1) % 3, (d + 2) % 3];
      faces[c + d] = edge(1, e) * edge(2, f) - edge(1, f) * edge(2, e);
    }
  }
  const dot = (f: number, g: number): number =>
    faces[f]! * faces[g]! + faces[f + 1]! * faces[g + 1]! + faces[f + 2]! * faces[g + 2]!;
  const isSmooth = (f: number, g: number): boolean =>
    dot(f, g) > Math.cos(crease) * Math.sqrt(dot(f, f) * dot(g, g));

  // Corners with the same normal form a tree, whose root has the normal.
  const parent = Uint32Array.from({ length: corners }, (_, c) => c);
  const root = (c: number): number => {
    while (parent[c] !== c) c = parent[c] = parent[parent[c]!]!;
    return c;
  };
  // By the two vertices of an edge: its corner at the smaller vertex and at the larger one, of the last triangle there.
  const edges = new Map<number, [number, number]>();
  for (let f = 0; f < corners; f += 3)
    for (let k = 0; k < 3; ++k) {
      const ends: [number, number] = [f + k, f + ((k + 1) % 3)];
      const [low, high] = ends.map((c) => triangles[c]!) as [number, number];
      if (low > high) ends.reverse();
      const key = Math.min(low, high) * vertices.length + Math.max(low, high);
      const other = edges.get(key);
      if (other && isSmooth(f, other[0] - (other[0] % 3)))
        for (const end of [0, 1]) parent[root(ends[end]!)] = root(other[end]!);
      edges.set(key, ends);
    }

  const sums = new Float64Array(3 * corners);
  for (let c = 0; c < corners; ++c)
    for (let d = 0; d < 3; ++d) sums[3 * root(c) + d]! += faces[c - (c % 3) + d]!;
  const normals = new Float32Array(3 * corners);
  for (let c = 0; c < corners; ++c) {
    const at = 3 * root(c);
    const length = Math.hypot(sums[at]!, sums[at + 1]!, sums[at + 2]!) || 1; // a triangle without area is not seen
    for (let d = 0; d < 3; ++d) normals[3 * c + d] = sums[at + d]! / length;
  }
  return { positions, normals };
}
