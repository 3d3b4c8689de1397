// The skin of a hand, or the surface of a flexible object. It is deformed here from the nodes with the weights of the
// description. So a smooth hand needs only the bytes of a coarse one.
import * as THREE from "three";
import type { Quality } from "./quality";
import type { Contact, Nodes, SkinDescription } from "./protocol";

export type Colouring = "skin" | "pressure" | "strain";
const SKIN_COLOUR = 0xd3a488;

// From pale skin over orange and red to violet, darker and darker. It resembles magma in reverse order.
const MAP = [0xf1dcc4, 0xfdc58b, 0xfb9b62, 0xf0645c, 0xcf4070, 0x9c2e7f, 0x5f187f].map((hex) => new THREE.Color(hex));

/** Colour of a value. `t` is 0..1 of the map's range. */
export function colourMap(t: number, out: THREE.Color): THREE.Color {
  const at = Math.min(1, Math.max(0, t)) * (MAP.length - 1);
  const low = Math.min(MAP.length - 2, Math.floor(at));
  return out.lerpColors(MAP[low]!, MAP[low + 1]!, at - low);
}

function largeOf(values: Float32Array): number {
  const some = values.filter((value) => value > 0).sort();
  return some[Math.floor(0.98 * (some.length - 1))] ?? 0;
}

export class Skin {
  readonly mesh: THREE.Mesh<THREE.BufferGeometry, THREE.MeshStandardMaterial>;
  /** 98 % of the positive values on the skin are not larger than this now: Pa or 1. The others may be far larger. */
  large = 0;
  private readonly positions: Float32Array;
  private readonly colours: Float32Array;
  private readonly values: Float32Array;
  private readonly nodePressure: Float32Array;
  private readonly nodeArea: Float32Array; // touching area of the contacts whose main node this is
  // per triangle: inverse of the rest shape's 2x2 edge matrix, and its area
  private readonly restEdges: Float32Array | null;

  constructor(
    private readonly description: SkinDescription,
    quality: Quality,
    private readonly objectColour: number | null, // of a flexible object; null: the skin of a hand
  ) {
    const vertices = description.weights.length / 4;
    this.positions = new Float32Array(3 * vertices);
    this.colours = new Float32Array(3 * vertices);
    this.values = new Float32Array(vertices);
    this.nodePressure = new Float32Array(description.nodeCount);
    this.nodeArea = new Float32Array(description.nodeCount);
    this.restEdges = description.restNodes.length === 3 * description.nodeCount ? this.measureRest() : null;
    const geometry = new THREE.BufferGeometry();
    geometry.setIndex(new THREE.BufferAttribute(description.triangles, 1));
    geometry.setAttribute("position", new THREE.BufferAttribute(this.positions, 3).setUsage(THREE.DynamicDrawUsage));
    geometry.setAttribute("color", new THREE.BufferAttribute(this.colours, 3).setUsage(THREE.DynamicDrawUsage));
    const material =
      quality === "high" && objectColour === null
        ? new THREE.MeshPhysicalMaterial({
            vertexColors: true,
            roughness: 0.52,
            sheen: 0.35,
            sheenRoughness: 0.45,
            sheenColor: new THREE.Color(0xff8866),
            specularIntensity: 0.55,
            envMapIntensity: 0.75,
          })
        : new THREE.MeshStandardMaterial({ vertexColors: true, roughness: 0.6 });
    // Light that enters flesh comes out red, most where the surface turns away from the viewer.
    if (objectColour === null)
      material.onBeforeCompile = (shader) => {
        shader.fragmentShader = shader.fragmentShader.replace(
          "#include <emissivemap_fragment>",
          `#include <emissivemap_fragment>
        float turned = 1.0 - saturate(dot(normal, normalize(vViewPosition)));
        totalEmissiveRadiance += diffuseColor.rgb * vec3(0.22, 0.05, 0.03) * (0.25 + 0.75 * turned * turned);`,
        );
      };
    this.mesh = new THREE.Mesh(geometry, material);
    this.mesh.castShadow = true;
    this.mesh.receiveShadow = true;
    this.mesh.frustumCulled = false;
    this.mesh.visible = false;
    this.paint("skin", 1);
  }

  get hasStrain(): boolean {
    return this.restEdges !== null;
  }

  deform(nodes: Nodes): boolean {
    if (nodes.positions.length !== 3 * this.description.nodeCount) return false;
    this.interpolate(nodes.positions, this.positions);
    this.mesh.position.fromArray(nodes.origin);
    this.mesh.geometry.getAttribute("position").needsUpdate = true;
    this.mesh.geometry.computeVertexNormals();
    this.mesh.visible = true;
    return true;
  }

  /** `contacts`: those of the hand. */
  press(contacts: Contact[]): void {
    this.pressNodes(contacts, ({ node }) => node);
  }

  /** `contacts`: of a hand, those with this flexible object. Each presses on the nearest vertex. */
  pressNearest(contacts: Contact[]): void {
    const x = this.positions;
    const { position } = this.mesh;
    this.pressNodes(contacts, ({ point }) => {
      const [px, py, pz] = [point[0]! - position.x, point[1]! - position.y, point[2]! - position.z];
      let nearest = 0;
      let least = Infinity;
      for (let v = 0; v < this.values.length; ++v) {
        const distance = (x[3 * v]! - px) ** 2 + (x[3 * v + 1]! - py) ** 2 + (x[3 * v + 2]! - pz) ** 2;
        if (distance < least) [least, nearest] = [distance, v];
      }
      return this.description.nodes[4 * nearest]!;
    });
  }

  private pressNodes(contacts: Contact[], nodeOf: (contact: Contact) => number): void {
    this.nodePressure.fill(0);
    this.nodeArea.fill(0);
    for (const contact of contacts) {
      const { force, area } = contact;
      const node = nodeOf(contact);
      if (node >= this.nodePressure.length || !(area > 0)) continue;
      this.nodePressure[node]! += Math.hypot(force[0]!, force[1]!, force[2]!);
      this.nodeArea[node]! += area;
    }
    for (let n = 0; n < this.nodeArea.length; ++n)
      if (this.nodeArea[n]! > 0) this.nodePressure[n]! /= this.nodeArea[n]!;
  }

  /** Computes the coloured quantity at every vertex: Pa or 1, and 0 for plain skin. Sets `large`. */
  measure(colouring: Colouring): void {
    if (colouring === "pressure") this.spreadPressure();
    else if (colouring === "strain" && this.restEdges) this.measureStrain(this.restEdges);
    else this.values.fill(0);
    this.large = largeOf(this.values);
  }

  /** Colours the skin by the measured values. Values from `full` on get the last colour of the map. */
  paint(colouring: Colouring, full: number): void {
    const colour = new THREE.Color(this.objectColour ?? SKIN_COLOUR);
    for (let v = 0; v < this.values.length; ++v) {
      if (colouring !== "skin") colourMap(this.values[v]! / full, colour);
      this.colours[3 * v] = colour.r;
      this.colours[3 * v + 1] = colour.g;
      this.colours[3 * v + 2] = colour.b;
    }
    this.mesh.geometry.getAttribute("color").needsUpdate = true;
  }

  dispose(): void {
    this.mesh.geometry.dispose();
    this.mesh.material.dispose();
  }

  private interpolate(nodes: Float32Array, out: Float32Array): void {
    const { nodes: indices, weights } = this.description;
    for (let v = 0, k = 0; v < out.length; v += 3, k += 4) {
      let x = 0;
      let y = 0;
      let z = 0;
      for (let i = k; i < k + 4; ++i) {
        const n = 3 * indices[i]!;
        const w = weights[i]!;
        x += w * nodes[n]!;
        y += w * nodes[n + 1]!;
        z += w * nodes[n + 2]!;
      }
      out[v] = x;
      out[v + 1] = y;
      out[v + 2] = z;
    }
  }

  private spreadPressure(): void {
    const { nodes: indices, weights } = this.description;
    for (let v = 0; v < this.values.length; ++v) {
      let value = 0;
      for (let i = 4 * v; i < 4 * v + 4; ++i) value += weights[i]! * this.nodePressure[indices[i]!]!;
      this.values[v] = Math.max(0, value);
    }
  }

  private measureRest(): Float32Array {
    const rest = new Float32Array(this.positions.length);
    this.interpolate(this.description.restNodes, rest);
    const { triangles } = this.description;
    const out = new Float32Array((4 * triangles.length) / 3);
    const p = new THREE.Vector3();
    const e1 = new THREE.Vector3();
    const e2 = new THREE.Vector3();
    for (let t = 0, o = 0; t < triangles.length; t += 3, o += 4) {
      p.fromArray(rest, 3 * triangles[t]!);
      e1.fromArray(rest, 3 * triangles[t + 1]!).sub(p);
      e2.fromArray(rest, 3 * triangles[t + 2]!).sub(p);
      // In the triangle's plane with x along e1: e1 = (a, 0), e2 = (b, c).
      const a = Math.max(e1.length(), 1e-9);
      const b = e1.dot(e2) / a;
      const c = Math.max(Math.sqrt(Math.max(0, e2.lengthSq() - b * b)), 1e-9);
      out.set([1 / a, -b / (a * c), 1 / c, (a * c) / 2], o);
    }
    return out;
  }

  // Largest principal strain of the skin's surface, tension or compression: |stretch - 1|. It is averaged over the
  // triangles of a vertex, weighted by area.
  private measureStrain(rest: Float32Array): void {
    const { triangles } = this.description;
    const x = this.positions;
    const areas = new Float32Array(this.values.length);
    this.values.fill(0);
    for (let t = 0, o = 0; t < triangles.length; t += 3, o += 4) {
      const i = 3 * triangles[t]!;
      const j = 3 * triangles[t + 1]!;
      const k = 3 * triangles[t + 2]!;
      const [ia, ib, ic, area] = [rest[o]!, rest[o + 1]!, rest[o + 2]!, rest[o + 3]!];
      let c11 = 0;
      let c12 = 0;
      let c22 = 0;
      for (let d = 0; d < 3; ++d) {
        const d1 = x[j + d]! - x[i + d]!;
        const d2 = x[k + d]! - x[i + d]!;
        const f1 = d1 * ia;
        const f2 = d1 * ib + d2 * ic;
        c11 += f1 * f1;
        c12 += f1 * f2;
        c22 += f2 * f2;
      }
      const mean = (c11 + c22) / 2;
      const spread = Math.hypot((c11 - c22) / 2, c12);
      const strain = Math.max(Math.sqrt(mean + spread) - 1, 1 - Math.sqrt(Math.max(0, mean - spread)));
      for (let n = t; n < t + 3; ++n) {
        this.values[triangles[n]!]! += area * strain;
        areas[triangles[n]!]! += area;
      }
    }
    for (let v = 0; v < areas.length; ++v) this.values[v]! /= Math.max(areas[v]!, 1e-12);
  }
}
