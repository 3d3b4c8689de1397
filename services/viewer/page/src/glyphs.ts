// Arrows of forces and skeletons, each drawn in two calls.
import * as THREE from "three";
import { JOINTS, type Skeleton } from "./protocol";

export type SkeletonKind = "tracked" | "intermediate" | "simulated";
export const SKELETON_COLOURS: Record<SkeletonKind, number> = {
  tracked: 0xe69f00,
  intermediate: 0x009e9e,
  simulated: 0x8456d6,
};
export const FORCE_COLOUR = 0xe0402a;
export const COUPLING_COLOUR = 0x2f7de1;
const METRES_PER_NEWTON = 0.025;
const LONGEST_ARROW = 0.15;

/** The parent (proximal) joint of each joint in OpenXR's order. -1 for the wrist. */
const PARENT = Array.from({ length: JOINTS }, (_, j) =>
  j === 1 ? -1 : j === 0 || j === 2 || (j >= 6 && (j - 6) % 5 === 0) ? 1 : j - 1,
);
const UP = new THREE.Vector3(0, 1, 0);

/** Up to `capacity` arrows, drawn in two calls. */
export class Arrows {
  readonly group = new THREE.Group();
  private readonly shafts: THREE.InstancedMesh;
  private readonly heads: THREE.InstancedMesh;
  private readonly matrix = new THREE.Matrix4();
  private readonly turn = new THREE.Quaternion();
  private readonly direction = new THREE.Vector3();
  private readonly from = new THREE.Vector3();
  private readonly scale = new THREE.Vector3();

  constructor(
    capacity: number,
    colour: number,
    private readonly radius: number,
    sides: number,
  ) {
    const material = new THREE.MeshStandardMaterial({
      color: colour,
      roughness: 0.5,
      emissive: colour,
      emissiveIntensity: 0.35,
      depthTest: false,
      transparent: true,
      opacity: 0.92,
    });
    this.shafts = new THREE.InstancedMesh(
      new THREE.CylinderGeometry(1, 1, 1, sides).translate(0, 0.5, 0),
      material,
      capacity,
    );
    this.heads = new THREE.InstancedMesh(new THREE.ConeGeometry(1, 1, sides).translate(0, 0.5, 0), material, capacity);
    for (const mesh of [this.shafts, this.heads]) {
      mesh.count = 0;
      mesh.frustumCulled = false;
      mesh.renderOrder = 3;
      this.group.add(mesh);
    }
  }

  clear(): void {
    this.shafts.count = this.heads.count = 0;
  }

  /** Adds an arrow that ends at `tip` if `into`, otherwise starts at `tip`. */
  add(tip: Float32Array, force: Float32Array, into: boolean): void {
    const n = this.shafts.count;
    if (n >= this.shafts.instanceMatrix.count) return;
    this.direction.fromArray(force);
    const length = Math.min(LONGEST_ARROW, this.direction.length() * METRES_PER_NEWTON);
    if (length < 0.0008) return;
    this.direction.normalize();
    const head = Math.min(0.5 * length, 4.5 * this.radius);
    this.turn.setFromUnitVectors(UP, this.direction);
    this.from.fromArray(tip);
    if (into) this.from.addScaledVector(this.direction, -length);
    this.shafts.setMatrixAt(
      n,
      this.matrix.compose(this.from, this.turn, this.scale.set(this.radius, length - head, this.radius)),
    );
    this.from.addScaledVector(this.direction, length - head);
    this.heads.setMatrixAt(
      n,
      this.matrix.compose(this.from, this.turn, this.scale.set(2.2 * this.radius, head, 2.2 * this.radius)),
    );
    this.shafts.count = this.heads.count = n + 1;
  }

  finish(): void {
    this.shafts.instanceMatrix.needsUpdate = this.heads.instanceMatrix.needsUpdate = true;
  }
}

/** A skeleton: a sphere at each joint, and a cone for each bone. */
export class Bones {
  readonly group = new THREE.Group();
  private readonly joints: THREE.InstancedMesh;
  private readonly links: THREE.InstancedMesh;

  constructor(kind: SkeletonKind) {
    const colour = SKELETON_COLOURS[kind];
    const material = new THREE.MeshStandardMaterial({
      color: colour,
      roughness: 0.45,
      emissive: colour,
      emissiveIntensity: 0.25,
      depthTest: false,
      transparent: true,
      opacity: 0.9,
    });
    this.joints = new THREE.InstancedMesh(new THREE.SphereGeometry(1, 14, 10), material, JOINTS);
    this.links = new THREE.InstancedMesh(new THREE.CylinderGeometry(0.6, 1, 1, 10), material, JOINTS);
    for (const mesh of [this.joints, this.links]) {
      mesh.count = 0;
      mesh.frustumCulled = false;
      mesh.renderOrder = 2;
      this.group.add(mesh);
    }
    this.group.visible = false;
  }

  clear(): void {
    this.joints.count = this.links.count = 0;
  }

  pose(skeleton: Skeleton): void {
    const matrix = new THREE.Matrix4();
    const a = new THREE.Vector3();
    const b = new THREE.Vector3();
    const turn = new THREE.Quaternion();
    const size = new THREE.Vector3();
    const none = new THREE.Matrix4().makeScale(0, 0, 0);
    skeleton.joints.forEach((joint, j) => {
      const parent = skeleton.joints[PARENT[j]!];
      this.joints.setMatrixAt(
        j,
        joint.valid
          ? matrix.compose(a.fromArray(joint.position), turn.identity(), size.setScalar(0.0036))
          : none,
      );
      if (!joint.valid || !parent?.valid) {
        this.links.setMatrixAt(j, none);
        return;
      }
      a.fromArray(parent.position);
      b.fromArray(joint.position);
      const length = a.distanceTo(b);
      size.subVectors(b, a).normalize();
      turn.setFromUnitVectors(UP, size);
      a.add(b).multiplyScalar(0.5);
      this.links.setMatrixAt(j, matrix.compose(a, turn, size.set(0.0022, length, 0.0022)));
    });
    this.joints.count = this.links.count = JOINTS;
    this.joints.instanceMatrix.needsUpdate = this.links.instanceMatrix.needsUpdate = true;
  }
}
