// Tests of the geometry that the page makes of an object file. The module runs alone, without a browser.
import assert from "node:assert/strict";
import { createRequire } from "node:module";
import { test } from "node:test";
import { build, source } from "./harness.mjs";

const work = `${build}/services/viewer/page/work`;
const { outputFiles } = createRequire(`${work}/`)("esbuild").buildSync({
  entryPoints: [`${source}/services/viewer/page/src/shapes.ts`],
  nodePaths: [`${work}/node_modules`],
  bundle: true,
  format: "esm",
  write: false,
});
const { shapeOf } = await import(
  `data:text/javascript;base64,${Buffer.from(outputFiles[0].contents).toString("base64")}`
);
const FILE = 6;
const made = (vertices, triangles) => shapeOf({ shape: FILE, size: [0, 0, 0], vertices, triangles }).attributes;

/** A cube with an edge of `edge` m, each side with n x n squares of two triangles. The vertices of sides are shared. */
function cube(edge, n) {
  const [vertices, triangles, known] = [[], [], new Map()];
  const vertex = (...at) => {
    const key = at.join();
    if (!known.has(key)) known.set(key, vertices.push(...at.map((x) => (edge * x) / n)) / 3 - 1);
    return known.get(key);
  };
  for (let axis = 0; axis < 3; ++axis)
    for (const side of [0, n]) {
      const at = (i, j) => [0, 1, 2].map((d) => (d === axis ? side : d === (axis + 1) % 3 ? i : j));
      for (let i = 0; i < n; ++i)
        for (let j = 0; j < n; ++j) {
          const [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)].map((x) => vertex(...x));
          triangles.push(...(side ? [a, b, c, a, c, d] : [a, c, b, a, d, c]));
        }
    }
  return [new Float32Array(vertices), new Uint32Array(triangles)];
}

test("the normals of a cube of 10 mm are those of its sides", () => {
  const { position, normal } = made(...cube(0.01, 3));
  for (let c = 0; c < normal.count; c += 3) {
    const at = (k, d) => position.array[3 * (c + k) + d];
    const axis = [0, 1, 2].find((d) => at(0, d) === at(1, d) && at(0, d) === at(2, d));
    const expected = [0, 1, 2].map((d) => (d !== axis ? 0 : at(0, d) > 0.005 ? 1 : -1));
    for (let k = 0; k < 3; ++k)
      for (let d = 0; d < 3; ++d) assert.ok(Math.abs(normal.array[3 * (c + k) + d] - expected[d]) < 1e-6);
  }
});

test("the rounded edge of a small object does not tilt the normals of its flat sides", () => {
  const profile = [[0, 0]];
  for (let i = 0; i <= 12; ++i) {
    const angle = (Math.PI / 24) * i;
    profile.push([0.006 + 0.002 * Math.sin(angle), -0.002 + 0.002 * Math.cos(angle)]);
  }
  profile.push([0.008, -0.008]);
  const vertices = profile.flatMap(([x, y]) => [x, y, 0, x, y, 0.005]);
  const triangles = profile.slice(1).flatMap((_, i) => [0, 1, 2, 1, 3, 2].map((v) => 2 * i + v));
  const { normal } = made(new Float32Array(vertices), new Uint32Array(triangles));
  for (let c = 0; c < 6; ++c) assert.ok(normal.getY(c) > Math.cos(0.05), `${normal.getY(c)}`);
  for (let c = normal.count - 6; c < normal.count; ++c) assert.ok(normal.getX(c) > Math.cos(0.05));
  for (let c = 6; c < normal.count - 6; ++c) {
    const angle = (Math.PI / 24) * (Math.floor(c / 6) - 0.5);
    const cosine = Math.sin(angle) * normal.getX(c) + Math.cos(angle) * normal.getY(c);
    assert.ok(cosine > Math.cos(0.15), "smooth");
    assert.ok(cosine < Math.cos(0.01), "not flat");
  }
});

test("the reads of vertices grow as the triangles, up to 100,000 of a small object, and a fan as large ends", () => {
  let reads = 0;
  const counted = (values) =>
    new Proxy(values, {
      get: (all, key) => {
        ++reads;
        return Reflect.get(all, key, all);
      },
    });
  const readsOf = ([vertices, triangles]) => {
    reads = 0;
    made(counted(vertices), counted(triangles));
    return reads;
  };
  const [few, many] = [cube(0.01, 13), cube(0.01, 130)];
  assert.ok(many[1].length / 3 > 100000);
  const growth = readsOf(many) / readsOf(few);
  assert.ok(growth < 101, `${growth} times the reads for 100 times the triangles`);
  const rim = Array.from({ length: 100000 }, (_, i) => [Math.cos(i), Math.sin(i), 0]).flat();
  const fan = Array.from({ length: 99998 }, (_, i) => [0, i + 1, i + 2]).flat();
  assert.equal(made(new Float32Array([0, 0, 1, ...rim]), new Uint32Array(fan)).normal.count, 3 * 99998);
});
