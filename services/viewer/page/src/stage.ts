// The three.js scene: light, floor, camera, and everything that the topics describe.
// World frame as on the topics: metres, +Y up.
import * as THREE from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { RoomEnvironment } from "three/addons/environments/RoomEnvironment.js";
import { ConvexGeometry } from "three/addons/geometries/ConvexGeometry.js";
import { toCreasedNormals } from "three/addons/utils/BufferGeometryUtils.js";
import {
  type Bone,
  type Contact,
  type Contacts,
  type Nodes,
  type ObjectDescription,
  type ObjectState,
  type Skeleton,
  type SkinDescription,
  BONES,
  FIRST_SOFT_OBJECT,
  JOINTS,
  Shape,
} from "./protocol";
import { type Colouring, Skin } from "./skin";

export type SkeletonKind = "tracked" | "intermediate" | "simulated";
export const SKELETON_COLOURS: Record<SkeletonKind, number> = {
  tracked: 0xe69f00,
  intermediate: 0x009e9e,
  simulated: 0x8456d6,
};
export const FORCE_COLOUR = 0xe0402a;
export const COUPLING_COLOUR = 0x2f7de1;
const OBJECT_COLOURS = [0x4f86c6, 0xe0a030, 0x5aa469, 0xb565a7, 0xd1603d, 0x3fa7a0];
const STATIC_COLOURS = { light: 0x9aa7b4, dark: 0x39424d }; // cool colours, so that the hand stands out
const METRES_PER_NEWTON = 0.025;
const LONGEST_ARROW = 0.15;

/** The parent (proximal) joint of each joint in OpenXR's order. -1 for the wrist. */
const PARENT = Array.from({ length: JOINTS }, (_, j) =>
  j === 1 ? -1 : j === 0 || j === 2 || (j >= 6 && (j - 6) % 5 === 0) ? 1 : j - 1,
);
const UP = new THREE.Vector3(0, 1, 0);

/** Up to `capacity` arrows, drawn in two calls. */
class Arrows {
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

class Bones {
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
      mesh.frustumCulled = false;
      mesh.renderOrder = 2;
      this.group.add(mesh);
    }
    this.group.visible = false;
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
    this.joints.instanceMatrix.needsUpdate = this.links.instanceMatrix.needsUpdate = true;
  }
}

interface Hand {
  skin: Skin | null;
  nodes: Nodes | null;
  contacts: Contact[];
  bones: Record<SkeletonKind, Bones>;
  contactArrows: Arrows;
  fingerArrows: Arrows;
  points: THREE.InstancedMesh<THREE.BufferGeometry, THREE.Material>;
  couplingArrows: Arrows;
}

/** low: for computers without a graphics card, and for slow ones. */
export type Quality = "high" | "low";

/** Returns high if a graphics card draws. */
export function bestQuality(): Quality {
  const context = document.createElement("canvas").getContext("webgl2");
  const info = context?.getExtension("WEBGL_debug_renderer_info");
  const name = info ? String(context!.getParameter(info.UNMASKED_RENDERER_WEBGL)) : "";
  context?.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|software|basic render/i.test(name) ? "low" : "high";
}

export interface Shown {
  hand: boolean;
  objects: boolean;
  tracked: boolean;
  intermediate: boolean;
  simulated: boolean;
  contacts: boolean;
  coupling: boolean;
  floor: boolean;
  beside: boolean;
}

export class Stage {
  readonly renderer: THREE.WebGLRenderer;
  private readonly camera = new THREE.PerspectiveCamera(38, 1, 0.01, 20);
  // A camera of its own, so that the page's view does not change during a session.
  private readonly headset = new THREE.PerspectiveCamera(50, 1, 0.02, 20);
  private dark = false;
  private seeThrough = false;
  private readonly controls: OrbitControls;
  private readonly scene = new THREE.Scene();
  private readonly hands = new Map<number, Hand>();
  private readonly objects = new Map<number, { mesh: THREE.Mesh; description: ObjectDescription }>();
  private readonly softObjects = new Map<number, { skin: Skin; nodes: Nodes | null }>();
  private readonly floor: THREE.Mesh;
  private readonly sun = new THREE.DirectionalLight(0xfff1e0, 2.4);
  private readonly sky = new THREE.HemisphereLight(0xffffff, 0xb8a898, 1);
  private shown: Shown;
  private readonly sideDirection = new THREE.Vector3(1, 0, 0); // horizontal, to the right on the screen
  private framed = false;
  private free = { left: 0, top: 0, right: 0, bottom: 0 };
  private scale = 1; // of the resolution; smaller if drawing takes too long
  private drawTime = 16; // ms, smoothed
  private adapts: boolean; // the resolution to the time that drawing takes
  colouring: Colouring = "skin";
  /** Present end of the colour map: Pa or 1. */
  full = 1;

  constructor(
    private readonly canvas: HTMLCanvasElement,
    shown: Shown,
    private readonly quality: Quality,
  ) {
    this.shown = shown;
    const fine = quality === "high";
    this.adapts = !fine;
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: fine, preserveDrawingBuffer: true });
    this.renderer.shadowMap.enabled = true;
    this.renderer.shadowMap.type = fine ? THREE.PCFSoftShadowMap : THREE.BasicShadowMap;
    this.renderer.toneMapping = THREE.ACESFilmicToneMapping;
    this.renderer.toneMappingExposure = 0.95;
    if (fine) {
      const generator = new THREE.PMREMGenerator(this.renderer);
      this.scene.environment = generator.fromScene(new RoomEnvironment(), 0.04).texture;
      generator.dispose();
    } else {
      this.scene.add(this.sky);
    }
    this.sun.position.set(-0.5, 1.05, 0.3);
    this.sun.castShadow = true;
    this.sun.shadow.mapSize.setScalar(fine ? 2048 : 512);
    const area = this.sun.shadow.camera;
    area.left = area.bottom = -0.4;
    area.right = area.top = 0.4;
    area.near = 0.2;
    area.far = 3;
    this.sun.shadow.bias = -0.0004;
    this.sun.shadow.normalBias = 0.0012;
    this.sun.shadow.radius = 5;
    const fill = new THREE.DirectionalLight(0x9fc0ff, 0.5);
    fill.position.set(0.3, 0.5, -0.9);
    this.scene.add(this.sun, this.sun.target, fill);
    this.floor = new THREE.Mesh(
      new THREE.CircleGeometry(3, 64).rotateX(-Math.PI / 2),
      new THREE.MeshStandardMaterial({ roughness: 0.95, metalness: 0 }),
    );
    this.floor.receiveShadow = true;
    this.scene.add(this.floor);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.enableDamping = true;
    this.controls.minDistance = 0.08;
    this.controls.maxDistance = 3;
    this.lookAtDefault();
    this.setTheme(false);
  }

  setTheme(dark: boolean): void {
    const background = new THREE.Color(dark ? 0x14171c : 0xe9edf1);
    this.dark = dark;
    this.scene.background = this.seeThrough ? null : background;
    this.scene.fog = this.seeThrough ? null : new THREE.Fog(background, 1.2, 3);
    (this.floor.material as THREE.MeshStandardMaterial).color.set(dark ? 0x23282f : 0xd9dee3);
    this.scene.environmentIntensity = dark ? 0.35 : 0.55;
    this.sky.intensity = dark ? 0.8 : 1.5;
    for (const { mesh, description } of this.objects.values())
      if (description.isStatic) (mesh.material as THREE.MeshStandardMaterial).color.set(this.staticColour);
  }

  /** Removes background and floor for a headset that shows the room. */
  setSeeThrough(seeThrough: boolean): void {
    this.seeThrough = seeThrough;
    this.setTheme(this.dark);
    this.applyShown();
  }

  show(shown: Shown): void {
    this.updateSideDirection();
    this.shown = shown;
    this.applyShown();
    this.fit();
  }

  lookAtDefault(): void {
    this.framed = false;
    this.controls.target.set(0, 0.11, 0);
    this.camera.position.set(-0.38, 0.29, -0.33);
    this.controls.update();
    this.updateSideDirection();
  }

  lookFrom(position: [number, number, number], target: [number, number, number]): void {
    this.framed = true;
    this.controls.target.set(...target);
    this.camera.position.set(...position);
    this.controls.update();
    this.updateSideDirection();
  }

  /**
   * Moves the camera as dragging and the wheel do: to the right and up around its target by angles (rad). Its distance
   * is multiplied by `distance`.
   */
  orbit(right: number, up: number, distance: number): void {
    const { target } = this.controls;
    const seat = new THREE.Spherical().setFromVector3(this.camera.position.clone().sub(target));
    seat.set(seat.radius * distance, seat.phi - up, seat.theta + right).makeSafe();
    this.camera.position.setFromSpherical(seat).add(target);
  }

  /** Adds something that the topics do not describe. */
  add(object: THREE.Object3D): void {
    this.scene.add(object);
  }

  /** Removes all hands and objects. */
  clear(): void {
    for (const hand of this.hands.values()) {
      const groups = [
        ...Object.values(hand.bones),
        hand.contactArrows,
        hand.fingerArrows,
        hand.couplingArrows,
      ].map(({ group }) => group);
      this.scene.remove(hand.points, ...groups);
      for (const mesh of [
        hand.points,
        ...groups.flatMap(({ children }) => children as THREE.InstancedMesh<THREE.BufferGeometry, THREE.Material>[]),
      ]) {
        mesh.geometry.dispose();
        mesh.material.dispose();
        mesh.dispose();
      }
      if (!hand.skin) continue;
      this.scene.remove(hand.skin.mesh);
      hand.skin.dispose();
    }
    this.hands.clear();
    for (const { mesh } of this.objects.values()) {
      this.scene.remove(mesh);
      mesh.geometry.dispose();
      (mesh.material as THREE.Material).dispose();
    }
    this.objects.clear();
    for (const instance of [...this.softObjects.keys()]) this.removeSoftObject(instance);
  }

  describeHand(instance: number, description: SkinDescription): void {
    const hand = this.hand(instance);
    if (hand.skin) {
      this.scene.remove(hand.skin.mesh);
      hand.skin.dispose();
    }
    hand.skin = new Skin(description, this.quality, null);
    this.scene.add(hand.skin.mesh);
    if (hand.nodes) this.deform(instance, hand.nodes);
    this.applyShown();
  }

  deform(instance: number, nodes: Nodes): void {
    const hand = this.hand(instance);
    hand.nodes = nodes;
    if (!hand.skin?.deform(nodes)) return;
    hand.skin.mesh.visible = this.shown.hand;
    if (this.colouring !== "skin") {
      hand.skin.measure(this.colouring);
      hand.skin.paint(this.colouring, this.full);
    }
    if (!this.framed) this.frame(hand.skin.mesh);
  }

  pose(instance: number, kind: SkeletonKind, skeleton: Skeleton): void {
    // Joints relative to a headset or desk have no world pose until `tracking` composes them.
    if (skeleton.frame === 0) this.hand(instance).bones[kind].pose(skeleton);
  }

  touch(instance: number, contacts: Contacts): void {
    const hand = this.hand(instance);
    hand.skin?.press(contacts.contacts);
    hand.contacts = contacts.contacts;
    hand.contactArrows.clear();
    hand.fingerArrows.clear();
    const matrix = new THREE.Matrix4();
    let n = 0;
    for (const contact of contacts.contacts) {
      hand.contactArrows.add(contact.point, contact.force, true);
      if (n < hand.points.instanceMatrix.count)
        hand.points.setMatrixAt(
          n++,
          matrix.makeScale(0.0011, 0.0011, 0.0011).setPosition(contact.point[0]!, contact.point[1]!, contact.point[2]!),
        );
    }
    hand.points.count = n;
    hand.points.instanceMatrix.needsUpdate = true;
    for (const finger of contacts.fingers)
      if (finger.count > 0) hand.fingerArrows.add(finger.centre, finger.force, false);
    hand.contactArrows.finish();
    hand.fingerArrows.finish();
  }

  couple(instance: number, valid: boolean, bones: Bone[]): void {
    const arrows = this.hand(instance).couplingArrows;
    arrows.clear();
    if (valid) for (const bone of bones) arrows.add(bone.intermediate, bone.couplingForce, false);
    arrows.finish();
  }

  describeObject(id: number, description: ObjectDescription): void {
    const old = this.objects.get(id);
    if (old) {
      this.scene.remove(old.mesh);
      old.mesh.geometry.dispose();
      this.objects.delete(id);
    }
    if (description.removed) return;
    const colour = description.isStatic ? this.staticColour : OBJECT_COLOURS[id % OBJECT_COLOURS.length]!;
    const mesh = new THREE.Mesh(
      shapeOf(description),
      new THREE.MeshStandardMaterial({
        color: colour,
        roughness: description.isStatic ? 0.8 : 0.45,
        flatShading: description.shape === Shape.hull,
      }),
    );
    mesh.castShadow = description.shape !== Shape.plane;
    mesh.receiveShadow = true;
    if (old) {
      mesh.position.copy(old.mesh.position);
      mesh.quaternion.copy(old.mesh.quaternion);
      mesh.userData.world = old.mesh.userData.world;
    }
    this.objects.set(id, { mesh, description });
    this.scene.add(mesh);
    this.applyShown();
  }

  describeSoftObject(instance: number, description: SkinDescription): void {
    const nodes = this.softObjects.get(instance)?.nodes ?? null;
    this.removeSoftObject(instance);
    if (description.nodeCount === 0) return;
    const colour = OBJECT_COLOURS[(instance + 1) % OBJECT_COLOURS.length]!;
    const skin = new Skin(description, this.quality, colour);
    this.softObjects.set(instance, { skin, nodes: null });
    this.scene.add(skin.mesh);
    if (nodes) this.deformSoftObject(instance, nodes);
  }

  deformSoftObject(instance: number, nodes: Nodes): void {
    const object = this.softObjects.get(instance);
    if (!object?.skin.deform(nodes)) return;
    object.nodes = nodes;
    object.skin.mesh.visible = this.shown.objects;
    if (this.colouring === "skin") return;
    object.skin.measure(this.colouring);
    object.skin.paint(this.colouring, this.full);
  }

  private pressSoftObjects(): void {
    const contacts = [...this.hands.values()].flatMap((hand) => hand.contacts);
    for (const [instance, { skin }] of this.softObjects)
      skin.pressNearest(contacts.filter(({ object }) => object === FIRST_SOFT_OBJECT + instance));
  }

  private removeSoftObject(instance: number): void {
    const object = this.softObjects.get(instance);
    if (!object) return;
    this.scene.remove(object.skin.mesh);
    object.skin.dispose();
    this.softObjects.delete(instance);
  }

  /**
   * Places all objects of a world. An object that is not listed is hidden, even if nobody removed it. Static objects
   * are listed too. An object without a known place is not drawn.
   */
  place(world: number, states: ObjectState[]): void {
    let changed = false;
    const listed = new Set(states.map(({ id }) => id));
    for (const [id, { mesh }] of this.objects) {
      if (mesh.userData.world !== world || listed.has(id)) continue;
      mesh.userData.world = undefined;
      changed = true;
    }
    for (const state of states) {
      const object = this.objects.get(state.id);
      if (!object) continue;
      object.mesh.position.fromArray(state.position);
      object.mesh.quaternion.fromArray(state.orientation);
      if (object.mesh.userData.world === undefined) changed = true;
      object.mesh.userData.world = world;
      const material = object.mesh.material as THREE.MeshStandardMaterial;
      material.emissive.set(state.owned ? 0x1c1206 : 0x000000);
    }
    if (changed) {
      this.applyShown();
      this.layFloor();
    }
  }

  /** Colours all hands and flexible objects. The end of the map follows the large values in steps 1, 2, 5. */
  repaint(): void {
    if (this.colouring === "pressure") this.pressSoftObjects();
    const skins = [...this.hands.values(), ...this.softObjects.values()].flatMap(({ skin }) => skin ?? []);
    for (const skin of skins) skin.measure(this.colouring);
    const large = Math.max(0, ...skins.map((skin) => skin.large));
    const least = this.colouring === "pressure" ? 1000 : 0.05;
    const range = niceCeiling(Math.max(least, large));
    if (range > this.full || large < 0.3 * this.full) this.full = range;
    for (const skin of skins) skin.paint(this.colouring, this.full);
  }

  private get staticColour(): number {
    return this.dark ? STATIC_COLOURS.dark : STATIC_COLOURS.light;
  }

  get handCount(): number {
    return this.hands.size;
  }
  get hasStrain(): boolean {
    return [...this.hands.values(), ...this.softObjects.values()].some(({ skin }) => skin?.hasStrain);
  }

  /**
   * Widths (CSS pixels) along the canvas's edges that controls cover. The camera's target is put in the middle of the
   * rest.
   */
  setFree(left: number, top: number, right: number, bottom: number): void {
    this.free = { left, top, right, bottom };
    this.fit();
  }

  render(): void {
    if (this.renderer.xr.isPresenting) {
      this.renderer.render(this.scene, this.headset);
      return;
    }
    const width = this.canvas.clientWidth;
    const height = this.canvas.clientHeight;
    const ratio = Math.min(window.devicePixelRatio, this.quality === "high" ? 2 : 1) * this.scale;
    const size = this.renderer.getSize(new THREE.Vector2());
    if (size.x !== width || size.y !== height || this.renderer.getPixelRatio() !== ratio) {
      this.renderer.setPixelRatio(ratio);
      this.renderer.setSize(width, height, false);
      this.fit();
    }
    this.controls.update();
    this.renderer.render(this.scene, this.camera);
  }

  // The frustum is that of the uncovered part. The picture continues around it.
  private fit(): void {
    const { left, top, right, bottom } = this.free;
    const { clientWidth, clientHeight } = this.canvas;
    const width = Math.max(1, clientWidth - left - right);
    const height = Math.max(1, clientHeight - top - bottom);
    this.camera.aspect = width / height;
    // A narrow screen shows the same width as a wide one.
    this.camera.fov =
      this.camera.aspect >= 1
        ? 38
        : 2 *
          THREE.MathUtils.radToDeg(
            Math.atan(Math.tan(THREE.MathUtils.degToRad(19)) / Math.sqrt(this.camera.aspect)),
          );
    // The view side by side needs more width.
    this.camera.zoom = this.shown.beside ? 0.55 * Math.min(1, Math.sqrt(this.camera.aspect)) : 1;
    this.camera.setViewOffset(width, height, -left, -top, clientWidth, clientHeight);
  }

  /**
   * Reduces the resolution if `elapsed` (ms between two pictures) stays long, and increases it again if there is time.
   */
  adapt(elapsed: number): void {
    if (!this.adapts || this.renderer.xr.isPresenting) return;
    this.drawTime += 0.1 * (Math.min(elapsed, 500) - this.drawTime);
    if (this.drawTime > 70 && this.scale > 0.5) this.scale = Math.max(0.5, this.scale - 0.125);
    else if (this.drawTime < 25 && this.scale < 1) this.scale = Math.min(1, this.scale + 0.125);
    else return;
    this.drawTime = 45;
  }

  /** Keeps the resolution at `scale` of the full one from now on. */
  fixResolution(scale: number): void {
    this.scale = scale;
    this.adapts = false;
  }

  private hand(instance: number): Hand {
    let hand = this.hands.get(instance);
    if (hand) return hand;
    hand = {
      skin: null,
      nodes: null,
      contacts: [],
      bones: {
        tracked: new Bones("tracked"),
        intermediate: new Bones("intermediate"),
        simulated: new Bones("simulated"),
      },
      // These arrows are a few pixels thick, and there may be hundreds of them. So each has few triangles.
      contactArrows: new Arrows(512, FORCE_COLOUR, 0.0006, 5),
      fingerArrows: new Arrows(6, FORCE_COLOUR, 0.0022, 14),
      points: new THREE.InstancedMesh(
        new THREE.IcosahedronGeometry(1),
        new THREE.MeshBasicMaterial({ color: 0xffd23f, depthTest: false, transparent: true }),
        512,
      ),
      couplingArrows: new Arrows(BONES, COUPLING_COLOUR, 0.0016, 12),
    };
    hand.points.count = 0;
    hand.points.frustumCulled = false;
    hand.points.renderOrder = 3;
    this.hands.set(instance, hand);
    this.scene.add(...Object.values(hand.bones).map((bones) => bones.group));
    this.scene.add(hand.contactArrows.group, hand.fingerArrows.group, hand.couplingArrows.group, hand.points);
    this.applyShown();
    return hand;
  }

  private updateSideDirection(): void {
    this.sideDirection.set(1, 0, 0).applyQuaternion(this.camera.quaternion).setY(0).normalize();
  }

  private applyShown(): void {
    for (const hand of this.hands.values()) {
      if (hand.skin) hand.skin.mesh.visible = this.shown.hand && hand.nodes !== null;
      for (const kind of ["tracked", "intermediate", "simulated"] as const) {
        hand.bones[kind].group.visible = this.shown[kind];
        // Side by side: the tracked skeleton to the left and the intermediate one to the right of the simulated hand.
        const away = kind === "simulated" || !this.shown.beside ? 0 : kind === "tracked" ? -0.17 : 0.17;
        hand.bones[kind].group.position.copy(this.sideDirection).multiplyScalar(away);
      }
      hand.contactArrows.group.visible = hand.fingerArrows.group.visible = hand.points.visible = this.shown.contacts;
      hand.couplingArrows.group.visible = this.shown.coupling;
    }
    for (const { mesh } of this.objects.values())
      mesh.visible = this.shown.objects && mesh.userData.world !== undefined;
    for (const { skin, nodes } of this.softObjects.values()) skin.mesh.visible = this.shown.objects && nodes !== null;
    this.floor.visible = this.shown.floor && !this.seeThrough;
  }

  // The floor lies below all static objects.
  private layFloor(): void {
    const box = new THREE.Box3();
    for (const { mesh, description } of this.objects.values())
      if (description.isStatic && description.shape !== Shape.plane && mesh.userData.world !== undefined)
        box.expandByObject(mesh);
    this.floor.position.y = box.isEmpty() ? -0.001 : Math.min(-0.001, box.min.y - 0.0005);
  }

  private frame(mesh: THREE.Mesh): void {
    this.framed = true;
    const centre = new THREE.Box3().setFromObject(mesh, true).getCenter(new THREE.Vector3());
    if (centre.distanceTo(this.controls.target) < 0.25) {
      const move = centre.multiplyScalar(0.5).addScaledVector(this.controls.target, 0.5).sub(this.controls.target);
      this.controls.target.add(move);
      this.camera.position.add(move);
    } else {
      this.camera.position.add(centre.clone().sub(this.controls.target));
      this.controls.target.copy(centre);
    }
    this.sun.target.position.copy(this.controls.target);
    this.sun.position.copy(this.controls.target).add(new THREE.Vector3(-0.5, 1.05, 0.3));
  }
}

/** The smallest of 1, 2 and 5 times a power of ten that is at least `value`. */
function niceCeiling(value: number): number {
  const power = 10 ** Math.floor(Math.log10(value));
  return [1, 2, 5, 10].map((step) => step * power).find((step) => step >= value * 0.9999)!;
}

function shapeOf({ shape, size, vertices, triangles }: ObjectDescription): THREE.BufferGeometry {
  const [x, y, z] = [size[0]!, size[1]!, size[2]!];
  switch (shape) {
    case Shape.sphere:
      return new THREE.SphereGeometry(x, 48, 32);
    case Shape.box:
      return new THREE.BoxGeometry(2 * x, 2 * y, 2 * z);
    case Shape.capsule:
      return new THREE.CapsuleGeometry(x, 2 * y, 16, 40);
    case Shape.cylinder:
      return new THREE.CylinderGeometry(x, x, 2 * y, 56);
    case Shape.hull: {
      const points = [];
      for (let i = 0; i + 2 < vertices.length; i += 3)
        points.push(new THREE.Vector3(vertices[i]!, vertices[i + 1]!, vertices[i + 2]!));
      return new ConvexGeometry(points);
    }
    case Shape.file: {
      const geometry = new THREE.BufferGeometry();
      geometry.setAttribute("position", new THREE.BufferAttribute(vertices, 3));
      geometry.setIndex(new THREE.BufferAttribute(triangles, 1));
      return toCreasedNormals(geometry, 0.6);
    }
    default:
      return new THREE.PlaneGeometry(4, 4).rotateX(-Math.PI / 2);
  }
}
